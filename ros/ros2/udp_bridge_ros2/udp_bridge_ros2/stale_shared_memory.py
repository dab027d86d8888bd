# SPDX-License-Identifier: Apache-2.0
"""Removal of Fast DDS shared memory whose process was killed, 64 MiB each with our profile.

Segments that may be in use stay. A running process holds a lock (flock) on the file that ends in
``_el`` beside each of its segments. A segment has no owner if its lock is free and it is too old to
belong to a process that is just starting. Ports stay, because processes share them.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

SHARED_MEMORY = Path("/dev/shm")
MIN_AGE_S = 10.0
"""A starting process creates the file and locks it a moment later."""
_LOCK_SUFFIX = "_el"


def remove_leftovers(folder: Path, *, now_s: float) -> int:
    """Remove segments without an owner; return their number.

    Parameters
    ----------
    folder
        Folder of shared memory; it may be missing.
    now_s
        Wall clock in seconds.
    """
    removed = 0
    for lock in folder.glob(f"fastdds_{'[0-9a-f]' * 16}{_LOCK_SUFFIX}"):
        with contextlib.suppress(OSError):  # owned by another user, locked, or just removed
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
