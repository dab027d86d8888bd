# SPDX-License-Identifier: Apache-2.0
"""Sequences of datagrams, each of them well-formed, that a receiver must survive."""

import pytest

from udp_bridge import parse
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.wire.header import Header
from udp_bridge.wire.repair import Offer, Request, parse_resend

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
        inbox.receive(memoryview(datagram), SENDER, now_nanos)
        for answer, _ in inbox.requests(now_nanos):
            header, offset = parse(answer)
            request = parse_resend(answer[offset:])
            assert isinstance(request, Request)
            for seq in range(header.seq_number, header.seq_number + request.messages):
                found.add((seq, header.time_sec, request.parts_max, request.parts))
    return found


def test_two_messages_of_one_number_are_requested_each_by_its_own_stamp_and_parts() -> None:
    first, second = part(5, 0, 2, 100), part(5, 20, 30, 99)  # a sender whose clock was set back
    found = requested([offer(4, 1, 99), first, second, offer(6, 1, 99), offer(6, 1, 99)])
    assert (5, 100, 2, (1,)) in found
    assert (5, 99, 30, tuple(range(20))) in found
    assert (5, 99, 30, tuple(range(21, 30))) in found


FAR = 1005 + (1 << 20)
POISONS = {
    "a part": [part(FAR, 0, 2, 2**31 - 1)],
    "a whole message": [part(FAR, number, 2, 2**31 - 1) for number in (0, 1)],
    "an Offer": [offer(FAR, 2, 2**31 - 1)],
    "an Offer before all else": [],
}


@pytest.mark.parametrize("poison", POISONS.values(), ids=POISONS)
def test_a_poison_number_does_not_end_repair(poison: list[bytes]) -> None:
    before = [part(1005, number, 2, 100) for number in (0, 1)] if poison else []
    first = offer(1005, 2, 100) if poison else offer(FAR, 2, 2**31 - 1)
    after = []
    for seq in (1006, 1007, 1009, 1010):  # of 1008 nothing comes
        after += [part(seq, 0, 2, seq - 905), offer(seq, 2, seq - 905)]
    found = requested([*before, first, *poison, *after])
    assert {(1008, 0, 0, ()), (1009, 104, 2, (1,)), (1010, 105, 2, (1,))} <= found
