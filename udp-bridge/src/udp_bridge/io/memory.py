# SPDX-License-Identifier: Apache-2.0
"""Keeps freed memory in the process, so that copies of large bodies reuse it.

A body is copied once or twice between a link and its user. New pages from the kernel cost more than
the copy: 5 MB would take twice as long.
"""

from __future__ import annotations

import ctypes

KEPT_BYTES = 128 << 20
"""Free memory at the end of a heap that is kept: copies of the largest bodies."""
LARGEST_KEPT_BYTES = 32 << 20
"""Larger requests are mapped and unmapped; the largest value that glibc allows."""
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3


def keep_memory() -> None:
    """Configure glibc; other C libraries are left as they are."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, LARGEST_KEPT_BYTES)
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
