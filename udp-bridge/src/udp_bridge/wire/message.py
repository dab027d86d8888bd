# SPDX-License-Identifier: Apache-2.0
"""A whole message, as a user sends and receives it."""

from __future__ import annotations

from typing import NamedTuple, Tuple

from .header import NANOS, Buffer, Header

Address = Tuple[str, int]
"""Host and port."""
TopicKey = Tuple[int, str]
"""msg_type and topic."""


class DatagramKey(NamedTuple):
    """Identifies a datagram, for example in a Credit that acknowledges it."""

    msg_type: int
    topic: str
    seq_number: int
    part_number: int


class Message(NamedTuple):
    """One message with its body."""

    msg_type: int
    topic: str
    link: str
    """Frame of the data in the transformation tree, or empty."""
    stamp_nanos: int
    """Stamp in nanoseconds since the POSIX epoch."""
    seq_number: int
    body: Buffer
    """Bytes-like and contiguous; a received one is a read-only memoryview of its own buffer."""
    parts: int = 1
    """Number of datagrams that it came in; of no meaning when sending."""

    def header(self, *, parts_max: int = 1) -> Header:
        """Return the header of the message's part 0."""
        time_sec, time_nsec = divmod(self.stamp_nanos, NANOS)
        return Header(
            self.msg_type,
            self.seq_number,
            0,
            parts_max,
            time_sec,
            time_nsec,
            self.topic,
            self.link,
        )

    def __str__(self) -> str:
        size = memoryview(self.body).nbytes
        parts = "1 part" if self.parts == 1 else f"{self.parts} parts"
        return f"{self.header()}: {size} bytes in {parts}"
