# SPDX-License-Identifier: Apache-2.0
"""Removes shared memory of Fast DDS whose process was killed: with our profile 64 MiB each time.

Rule: what may still be in use stays. A living process holds a lock (flock) on the file that ends
in ``_el`` beside each of its segments; one that nobody holds, and that is too old to be of a
process which is just starting, has no owner any more. Ports are left alone: processes share them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
MIN_AGE_S = 10.0
"""A process that starts makes the file first and locks it a moment later."""
_LOCK_SUFFIX = "_el"


def remove_leftovers(folder: Path, *, now_s: float) -> int:
    """Remove segments without an owner; return how many there were.

    Parameters
    ----------
    folder
        Where shared memory lies; nothing happens where it does not exist.
    now_s
        The wall clock.
    """
    removed = 0
    for lock in folder.glob(f"fastdds_{'[0-9a-f]' * 16}{_LOCK_SUFFIX}"):
        with contextlib.suppress(OSError):  # somebody else's, locked, or just gone
            if now_s - lock.stat().st_mtime < MIN_AGE_S:
                continue
            descriptor = os.open(lock, os.O_RDONLY)
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
                lock.with_name(lock.name.removesuffix(_LOCK_SUFFIX)).unlink(missing_ok=True)
                lock.unlink()
                removed += 1
            finally:
                os.close(descriptor)
    return removed
