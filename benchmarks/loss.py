# SPDX-License-Identifier: Apache-2.0
"""What arrives over a lossy link, with and without repair: `python -m benchmarks.loss`.

Rule: every row of the table is a seeded run in virtual time of the bridge's own rules over the
project's own link, beside what probability theory says of it where it does. What was handed over
is compared byte by byte with what was sent.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
import time
from collections.abc import Iterator
from typing import NamedTuple

from groundlink.emulation import Impairment
from udp_bridge import Message
from udp_bridge.fec import repair_count
from udp_bridge.fragments import DatagramSize, plan
from udp_bridge.repair import Fec, Mode, parse_mode

from .virtual_link import LINK, MSG_TYPE, NANOS, TOPIC, VirtualLink

PERIOD_NANOS = NANOS // 10
SETTLE_NANOS = 3 * NANOS
"""Time after the last message in which it may be repaired or given up."""
MODES: dict[str, object] = {"none": "none", "fec": {"fec": 0.2}, "resend": {"resend": 0.5}}
SIZES: dict[DatagramSize, int] = {256: 64, "mtu": 16, "loopback": 4}
"""Datagram sizes, and the parts of each message."""


class Cell(NamedTuple):
    """One run of the matrix."""

    loss: float
    burst: float
    """Mean number of datagrams lost in a row; 0 = each on its own."""
    datagram: DatagramSize
    mode: str

    @property
    def parts(self) -> int:
        """Return the number of parts of each message."""
        return SIZES[self.datagram]

    @property
    def body_size(self) -> int:
        """Return the bytes of a body that fills these parts."""
        small = Message(MSG_TYPE, TOPIC, LINK, 0, 0, bytes(1))
        is_coded = isinstance(mode_of(self.mode), Fec)
        return self.parts * plan(small, self.datagram, coded=is_coded).part_size

    @property
    def impairment(self) -> Impairment:
        """Return the link of this run: 20 ms there and back."""
        return Impairment(loss=self.loss, burst=self.burst, delay_ms=10)


class Outcome(NamedTuple):
    """What came of a run."""

    sent: int
    delivered: int
    different: int
    """Messages that were handed over twice, or with other bytes than were sent."""
    in_time: int
    """Delivered, and not older than `limit`."""
    ages_nanos: list[int]
    """Of what was delivered, sorted."""
    sent_bytes: int
    """Headers and repair included."""


def deliver(
    link: VirtualLink, messages: int, body_size: int, rng: random.Random, limit_nanos: int
) -> Outcome:
    """Send messages of random bytes and return what came of them."""
    sent = {}
    for _ in range(messages):
        sent[link.now_nanos] = rng.randbytes(body_size)
        link.send(sent[link.now_nanos])
        link.advance(PERIOD_NANOS)
    link.advance(SETTLE_NANOS)
    stamps = {handed.message.stamp_nanos for handed in link.handed}
    different = len(link.handed) - len(stamps)
    ages = []
    for message, at_nanos in link.handed:
        told = message.msg_type, message.topic, message.link
        is_same = told == (MSG_TYPE, TOPIC, LINK) and sent.get(message.stamp_nanos) == message.body
        different += not is_same
        ages.append(at_nanos - message.stamp_nanos)
    in_time = sum(age <= limit_nanos for age in ages)
    return Outcome(messages, len(stamps), different, in_time, sorted(ages), link.sent_bytes)


def run(cell: Cell, messages: int, *, seed: int) -> Outcome:
    """Run one cell of the matrix."""
    link = VirtualLink(cell.impairment, seed=seed, datagram=cell.datagram, mode=mode_of(cell.mode))
    return deliver(link, messages, cell.body_size, random.Random(seed), NANOS // 2)


def mode_of(name: str) -> Mode | None:
    """Return the mode that a name of `MODES` stands for."""
    return parse_mode(MODES[name])


def expected(cell: Cell) -> float | None:
    """Return the probability that a message arrives, where theory says one.

    Without repair all parts must: (1-p)^parts, and in bursts, a Markov chain of two states, the
    first part must find the good state and the others stay there. With a code, as many symbols
    as there are parts, counted for independent losses; RaptorQ needs one more in about 1 % of
    the cases in which exactly as many arrive.
    """
    if cell.mode == "none":
        stays = 1 - (cell.impairment.chance_of_burst() if cell.burst else cell.loss)
        return (1 - cell.loss) * stays ** (cell.parts - 1)
    mode = mode_of(cell.mode)
    if isinstance(mode, Fec) and not cell.burst:
        repair = repair_count(cell.parts, mode.share)
        return sum(binomial(cell.parts + repair, lost, cell.loss) for lost in range(repair + 1))
    return None


def binomial(count: int, hits: int, chance: float) -> float:
    """Return the probability of so many hits among `count`."""
    return math.comb(count, hits) * chance**hits * (1 - chance) ** (count - hits)


def matrix() -> Iterator[Cell]:
    """Yield every cell; a link without loss has no bursts."""
    for mode in MODES:
        for datagram in SIZES:
            for loss in (0.0, 0.001, 0.01, 0.05, 0.1):
                for burst in (0.0, 5.0) if loss else (0.0,):
                    yield Cell(loss, burst, datagram, mode)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.loss")
    parser.add_argument("--messages", type=int, default=1000, help="of each row")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mode", choices=MODES, help="this one alone")
    parser.add_argument("--loss", type=float, help="this one alone")
    parser.add_argument("--parts", type=int, help="messages of so many parts alone")
    arguments = parser.parse_args()
    started = time.monotonic()
    print("mode    parts   loss  burst  delivered   theory   age p50      p99   overhead")
    for cell in matrix():
        wanted = (
            (arguments.mode, cell.mode),
            (arguments.loss, cell.loss),
            (arguments.parts, cell.parts),
        )
        if any(only is not None and only != value for only, value in wanted):
            continue
        outcome = run(cell, arguments.messages, seed=arguments.seed)
        theory = expected(cell)
        ages = outcome.ages_nanos or [0]
        p50, p99 = (ages[int(share * (len(ages) - 1))] / 1e6 for share in (0.5, 0.99))
        overhead = outcome.sent_bytes / (outcome.sent * cell.body_size) - 1
        print(
            f"{cell.mode:7} {cell.parts:5} {cell.loss:6.1%} {cell.burst or 1:6.0f}"
            f" {outcome.delivered / outcome.sent:10.3%}"
            f" {'' if theory is None else format(theory, '.3%'):>8}"
            f" {p50:6.1f} ms {p99:5.1f} ms {overhead:9.1%}"
            + (f"  {outcome.different} DIFFER" if outcome.different else ""),
            flush=True,
        )
    print(f"in {time.monotonic() - started:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
