# SPDX-License-Identifier: Apache-2.0
"""Bodies of the reports in Control (type 64), to the byte: TopicReport and LinkReport.

Each class packs and parses itself. Nothing here counts.
"""

from __future__ import annotations

import re
from struct import Struct
from typing import Any, Dict, Iterator, NamedTuple, Tuple

from .header import Buffer, Refused

_TOPIC_REPORT = Struct("<BBxxIqQQQQQQQQQqqqqq")
_LINK_REPORT = Struct("<BxxxIQQQQ")
_REASON = Struct("<QB")
_REASON_NAME = re.compile(rb"[a-z0-9_]{1,32}")
REASONS_MAX = 32
"""Reasons for refusal in a LinkReport at most; the most frequent ones."""

NO_AGE = -(1 << 63)
"""Age in a report without recently published messages."""


class TopicReport(NamedTuple):
    """Kind 1: delivery counts of one topic, since the receiver knows this sender.

    The header carries the reported topic and the link last seen, and the receiver's wall clock.
    """

    msg_type: int
    """Type of the reported topic."""
    first_number: int
    """Lowest seq_number of which a datagram arrived."""
    since_nanos: int
    """Identifies this count: another value means that the count was restarted."""
    numbers: int
    """Messages from the first to the one with the highest number seen, both included."""
    published: int
    """Messages that reached their user, such as a ROS publisher."""
    dropped: int
    """Whole messages that a newer one displaced, or that the user can't take."""
    incomplete: int
    """Messages given up with parts missing."""
    late: int
    """Whole messages behind a newer one."""
    pending: int
    """Messages whose parts are still awaited, or that wait to be published."""
    repaired: int
    """Messages handed over that would be incomplete without repair."""
    duplicates: int
    """Datagrams that had arrived before, since the receiver started."""
    body_bytes: int
    """Of the messages published."""
    first_seen_stamp_nanos: int
    """Stamp of the first message of which a datagram arrived."""
    first_stamp_nanos: int
    """Stamp of the first message published; 0 when there was none."""
    last_stamp_nanos: int
    """Stamp of the last message published; 0 when there was none."""
    age_p50_nanos: int
    """Median of receiver's wall clock minus stamp at publication, over the last 10 s and at most
    1024 messages; `NO_AGE` when there were none."""
    age_p99_nanos: int
    """Age that 99 % of these messages do not exceed."""

    @property
    def missing(self) -> int:
        """Messages between the first and the highest number of which no datagram arrived."""
        known = self.published + self.dropped + self.incomplete + self.late + self.pending
        return self.numbers - known

    def pack(self) -> bytes:
        """Return the 128 bytes of the body."""
        return _TOPIC_REPORT.pack(1, *self)

    @classmethod
    def parse(cls, body: Buffer) -> TopicReport:
        """Return the parsed body, or raise `Refused`."""
        if len(body) != _TOPIC_REPORT.size:
            raise Refused("body_size")
        _, *fields = _TOPIC_REPORT.unpack(body)
        report = cls(*fields)
        if report.missing < 0:
            raise Refused("body_value")
        return report


class LinkReport(NamedTuple):
    """Kind 2: totals of a socket, counted since the receiver started."""

    receive_buffer: int
    """Bytes of the receive buffer as the kernel accounts them."""
    datagrams: int
    bytes_received: int
    refused: int
    """Datagrams that broke a rule of the protocol."""
    kernel_drops: int
    """Datagrams that the kernel dropped because the receive buffer was full."""
    reasons: Tuple[Tuple[str, int], ...] = ()
    """Refused datagrams by reason, the most frequent first."""

    @classmethod
    def of(
        cls,
        receive_buffer: int,
        datagrams: int,
        bytes_received: int,
        kernel_drops: int,
        refused: Dict[str, int],
    ) -> LinkReport:
        """Return a report with the refused datagrams counted and their reasons in order."""
        reasons = sorted(refused.items(), key=lambda row: (-row[1], row[0]))[:REASONS_MAX]
        total = sum(refused.values())
        return cls(receive_buffer, datagrams, bytes_received, total, kernel_drops, tuple(reasons))

    def pack(self) -> bytes:
        """Return the body: 40 bytes, and 9 and the name for each reason."""
        parts = [_LINK_REPORT.pack(2, *self[:5])]
        for name, count in self.reasons:
            parts.append(_REASON.pack(count, len(name)) + name.encode("ascii"))
        return b"".join(parts)

    @classmethod
    def parse(cls, body: Buffer) -> LinkReport:
        """Return the parsed body, or raise `Refused`."""
        if len(body) < _LINK_REPORT.size:
            raise Refused("body_size")
        _, *fields = _LINK_REPORT.unpack_from(body)
        reasons = tuple(_reasons(bytes(body)[_LINK_REPORT.size :]))
        return cls(*fields)._replace(reasons=reasons)


def _reasons(rest: bytes) -> Iterator[Any]:
    for _ in range(REASONS_MAX):
        if not rest:
            return
        if len(rest) < _REASON.size:
            raise Refused("body_size")
        count, size = _REASON.unpack_from(rest)
        name = rest[_REASON.size : _REASON.size + size]
        if len(name) != size:
            raise Refused("body_size")
        if not _REASON_NAME.fullmatch(name):
            raise Refused("body_value")
        yield name.decode("ascii"), count
        rest = rest[_REASON.size + size :]
    if rest:
        raise Refused("body_size")
