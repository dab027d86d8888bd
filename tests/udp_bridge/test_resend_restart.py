# SPDX-License-Identifier: Apache-2.0
"""A sender that is restarted at random moments while lost datagrams are sent again.

Its numbers begin at 0, so that what it sends looks like something old; what is old comes again,
too. Whole simulated links, then single datagrams.
"""

import random

import pytest

from services.gateway.virtual_link import SENDER
from udp_bridge import Message
from udp_bridge.receiver.reassembly import Reassembler
from udp_bridge.sender.repair import Resend
from udp_bridge.wire.header import Header
from udp_bridge.wire.message import Message as Whole
from udp_bridge.wire.repair import Offer

from .simulated import MS, SECOND, Loss, Simulation, bursts, independent, no_loss

LIMIT = 500 * MS
REPAIR_TIME = 150 * MS
"""A message so old is whole, or was lost with the history of the sender that sent it."""


def links(kind: str, seed: int) -> Loss:
    rng = random.Random(seed)
    kinds = {"none": no_loss, "10 %": independent(rng, 0.1), "bursts": bursts(rng, 0.05, 5)}
    return kinds[kind]


@pytest.mark.parametrize("kind", ["none", "10 %", "bursts"])
@pytest.mark.parametrize(
    ("datagram", "size", "period"),
    [(256, 227, 100 * MS), (256, 64 * 232 - 5, 100 * MS), ("loopback", 4 * 65_280, 100 * MS)],
    ids=["1 part", "64 parts", "4 large parts"],
)
def test_nothing_is_lost_or_doubled(kind: str, datagram: object, size: int, period: int) -> None:
    for seed in range(4):
        rng = random.Random(seed)
        sim = Simulation(
            repair={(1, "/p"): Resend(LIMIT)},
            loss=links(kind, seed),
            loss_back=links(kind, seed + 1000),
            delay=10 * MS,
            datagram=datagram,
        )
        restarts = sorted(rng.randrange(100 * MS, 5 * SECOND) for _ in range(6))
        for when in restarts:
            sim.at(when, sim.restart_sender)
        body = rng.randbytes(size)
        sent = range(0, 6 * SECOND, period)
        for stamp in sent:
            sim.send_at(stamp, Message(1, "/p", "l", stamp, 0, body))
        sim.run(8 * SECOND)
        came = [message.stamp_nanos for _, message in sim.delivered]
        assert len(came) == len(set(came)), seed
        for stamp in set(sent) - set(came):
            assert any(0 < when - stamp <= REPAIR_TIME for when in restarts), (seed, stamp)
        # The receiver's report is about what was sent since the last restart, and all of it.
        report = sim.receiver.reassembler.reports(SENDER, 0)[0][2]
        since_restart = [stamp for stamp in sent if stamp >= restarts[-1]]
        assert (report.first_number, report.numbers, report.missing) == (0, len(since_restart), 0)
        assert report.first_seen_stamp_nanos >= restarts[-1]


class Topic:
    """One offered topic at a receiver, datagram by datagram; three parts a message."""

    def __init__(self) -> None:
        self.reassembler = Reassembler()

    def part(self, number: int, seq: int, stamp: int, now: int) -> Whole | None:
        header = Header(1, seq, number, 3, *divmod(stamp, SECOND), "/p")
        return self.reassembler.receive(header.pack() + b"12345678", SENDER, now)

    def parts(self, seq: int, stamp: int, now: int) -> list[Whole]:
        came = [self.part(number, seq, stamp, now) for number in range(3)]
        return [message for message in came if message is not None]

    def offer(self, seq: int, stamp: int, now: int) -> None:
        header = Header(65, seq, 0, 1, *divmod(stamp, SECOND), "/p")
        self.reassembler.receive(header.pack() + Offer(1, 3, 500).pack(), SENDER, now)

    def asked(self) -> list[tuple[int, tuple[int, ...], int]]:
        return [
            (asked.seq_number, asked.request.parts, asked.request.messages)
            for _, _, asked in self.reassembler.take_nacks()
        ]

    @property
    def numbers(self) -> tuple[int, int]:
        report = self.reassembler.reports(SENDER, 0)[0][2]
        return report.first_number, report.numbers


@pytest.fixture
def topic() -> Topic:
    topic = Topic()
    for seq in range(5):
        assert topic.parts(seq, seq * 100 * MS, seq * 100 * MS)
        topic.offer(seq, seq * 100 * MS, seq * 100 * MS)
    return topic


NOW = 450 * MS


def test_the_first_part_shows_it(topic: Topic) -> None:
    topic.part(0, 0, NOW, NOW)
    assert topic.numbers == (0, 1)
    assert topic.reassembler.counters.incomplete == 0


def test_first_offer_reveals_a_restart_and_its_messages_are_requested(topic: Topic) -> None:
    topic.offer(0, NOW, NOW)
    assert topic.asked() == [(0, (), 1)]
    assert len(topic.parts(0, NOW, NOW)) == 1
    assert topic.numbers == (0, 1)


def test_lost_first_messages_are_requested(topic: Topic) -> None:
    assert topic.parts(2, NOW, NOW)
    topic.offer(2, NOW, NOW + MS)
    assert topic.asked() == [(0, (), 2)]
    assert topic.parts(1, NOW - MS, NOW + 2 * MS)
    assert topic.numbers == (1, 2)


def test_earlier_messages_reveal_no_restart(topic: Topic) -> None:
    topic.offer(4, 400 * MS, NOW)
    topic.offer(3, 300 * MS, NOW)
    assert topic.parts(4, 400 * MS, NOW) == []
    assert topic.numbers == (0, 5)
    assert topic.asked() == []


@pytest.mark.parametrize("stamp", [550 * MS, 650 * MS])  # topics such as /tf mix their stamps
def test_missed_messages_reveal_no_restart(topic: Topic, stamp: int) -> None:
    topic.parts(6, 600 * MS, 600 * MS)
    topic.parts(5, stamp, 620 * MS)
    assert topic.numbers == (0, 7)


def test_a_number_that_came_in_part_with_another_stamp_shows_it(topic: Topic) -> None:
    topic.part(0, 5, 500 * MS, 500 * MS)
    assert topic.parts(5, 600 * MS, 600 * MS)
    assert topic.numbers == (5, 1)
    assert topic.reassembler.counters.incomplete == 1
