# SPDX-License-Identifier: Apache-2.0
"""Sequences of datagrams, each of them well-formed, that a receiver must survive."""

from __future__ import annotations

from udp_bridge import parse
from udp_bridge.header import Header
from udp_bridge.receiving import Inbox
from udp_bridge.repair_wire import Offer, Request, parse_resend

SENDER = ("192.0.2.1", 1)
MS = 1_000_000


def part(seq: int, number: int, parts_max: int, sec: int) -> bytes:
    return Header(1, seq, number, parts_max, sec, 0, "/p").pack() + b"12345678"


def offer(seq: int, parts_max: int, sec: int) -> bytes:
    return Header(65, seq, 0, 1, sec, 0, "/p").pack() + Offer(1, parts_max, 500).pack()


def requested(datagrams: list[bytes]) -> set[tuple[int, int, int, tuple[int, ...]]]:
    """Return seq_number, seconds of the stamp, parts_max and parts of all requests."""
    inbox = Inbox(receive_buffer=1 << 20, on_credit=lambda *_: None)
    found = set()
    for index, datagram in enumerate(datagrams):
        now_nanos = index * 2 * MS
        inbox.receive(memoryview(datagram), SENDER, now_nanos, 0)
        for answer, _ in inbox.requests(now_nanos):
            header, offset = parse(answer)
            request = parse_resend(answer[offset:])
            assert isinstance(request, Request)
            found.add((header.seq_number, header.time_sec, request.parts_max, request.parts))
    return found


def test_two_messages_of_one_number_are_requested_each_by_its_own_stamp_and_parts() -> None:
    first, second = part(5, 0, 2, 100), part(5, 20, 30, 99)  # a sender whose clock was set back
    found = requested([offer(4, 1, 99), first, second, offer(6, 1, 99), offer(6, 1, 99)])
    assert (5, 100, 2, (1,)) in found
    assert (5, 99, 30, tuple(range(20))) in found
    assert (5, 99, 30, tuple(range(21, 30))) in found
