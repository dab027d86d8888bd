# SPDX-License-Identifier: Apache-2.0
"""Keeps the memory that large bodies were copied into, for the next ones.

Rule: it changes nothing but speed. Between a link and its user a body is copied once or twice, and
pages that are fresh from the kernel cost more than the copy: 5 MB then take twice as long.
"""

from __future__ import annotations

import ctypes

KEPT_BYTES = 128 << 20
"""Free memory at the end of a heap that is not given back: the copies of the largest bodies."""
LARGEST_KEPT_BYTES = 32 << 20
"""Larger requests are mapped and unmapped; glibc allows no more."""
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3


def keep_memory() -> None:
    """Tell glibc; another C library does as it likes."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, LARGEST_KEPT_BYTES)
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
