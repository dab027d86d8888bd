# SPDX-License-Identifier: Apache-2.0
"""Images that the transports send."""

import random
import struct
from functools import cache

TOPIC = "/image"
IMAGE = 33
"""Type of an Image on the wire."""

IMAGE_HEAD_BYTES = 52
"""Bytes of an Image in CDR before its pixels, with the names used here."""


@cache
def random_pixels(size: int) -> bytes:
    """Return incompressible bytes, the same for the same size."""
    return random.Random(size).randbytes(size)


@cache
def image_cdr(size: int) -> bytes:
    """Return a sensor_msgs/Image in CDR of `size` bytes, at least those of its head."""
    data = random_pixels(max(0, size - IMAGE_HEAD_BYTES))
    frame, encoding = b"camera\0", b"mono8\0"
    body = struct.pack("<iI", 0, 0) + struct.pack("<I", len(frame)) + frame
    body += bytes(-len(body) % 4) + struct.pack("<II", 1, len(data))
    body += struct.pack("<I", len(encoding)) + encoding + b"\0"
    body += bytes(-len(body) % 4) + struct.pack("<II", len(data), len(data)) + data
    return b"\x00\x01\x00\x00" + body
