# SPDX-License-Identifier: Apache-2.0
"""Keeps freed memory in the process, so that the arrays of the next reading reuse it.

A LiDAR needs tens of megabytes for each revolution. Without this the C library returns them to the
kernel, and the new pages of the next revolution take a quarter of the sensor's processor time.
`udp_bridge.io.memory` does the same for links, which know nothing of Groundlink.
"""

import ctypes

KEPT_BYTES = 128 << 20
"""Free memory at the end of the heap that is kept: the arrays of several sensors."""

LARGEST_KEPT_BYTES = 32 << 20
"""Larger requests are mapped and unmapped; the largest value that glibc allows."""

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3


def keep_memory() -> None:
    """Configure glibc; other C libraries are left as they are.

    Call it after a world was loaded: arrays that only loading needs go back to the kernel.
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, LARGEST_KEPT_BYTES)
        mallopt(_M_TRIM_THRESHOLD, KEPT_BYTES)
