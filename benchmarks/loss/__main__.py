# SPDX-License-Identifier: Apache-2.0
"""Delivery over a lossy link with and without repair: `python -m benchmarks.loss`.

Every row of the table is a seeded simulation in virtual time: the bridge's sender and receiver and
the project's emulated link. Where probability theory predicts the result it is shown beside.
Delivered bodies are compared byte by byte with those sent.
"""

import argparse
import math
import random
import sys
import time
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from groundlink.core.clock import NANOS
from groundlink.emulation.settings import Impairment
from udp_bridge import Message
from udp_bridge.sender.repair import Fec, Mode, parse_mode
from udp_bridge.wire.fec import repair_count
from udp_bridge.wire.fragments import DatagramSize, plan

from .symmetric_link import LINK, MSG_TYPE, TOPIC, SymmetricLink

PERIOD_NANOS = NANOS // 10
SIGMAS = 4.0
SETTLE_NANOS = 3 * NANOS
"""Time after the last message in which it may be repaired or given up."""
LIMIT_NANOS = NANOS // 2
"""What is older is not in time; the limit of `resend` below."""
MODES: dict[str, object] = {"none": "none", "fec": {"fec": 0.2}, "resend": {"resend": 0.5}}
SHAPES: tuple[tuple[DatagramSize, int], ...] = (
    (256, 64),
    (1400, 1),
    (1400, 16),
    (1400, 64),
    (8192, 8),
    ("loopback", 1),
    ("loopback", 4),
)
"""Datagram sizes, and the parts of each message; `loopback` stands for 65,280 bytes a part."""
LARGE: tuple[tuple[DatagramSize, int], ...] = ((8192, 64), ("loopback", 64))
"""What takes a while; on demand."""
REPAIRED = {("fec", 0.05, 0.0): 0.9999, ("resend", 0.1, 0.0): 0.999, ("resend", 0.05, 5.0): 0.999}
"""By mode, loss and burst, the share that is to arrive, by `resend` in time; with `fec` of
messages of 64 parts, as a fifth of fewer parts is coarse."""


class Cell(NamedTuple):
    """One run of the matrix."""

    loss: float
    burst: float
    """Mean number of datagrams lost in a row; 0 = each on its own."""
    datagram: DatagramSize
    parts: int
    """Of each message."""
    mode: str

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
    link: SymmetricLink, messages: int, body_size: int, rng: random.Random, limit_nanos: int
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
    """Run one cell of the matrix; each has a seed of its own, made of `seed` and the cell."""
    own = zlib.crc32(f"{seed} {'-'.join(map(str, cell))}".encode())
    link = SymmetricLink(cell.impairment, seed=own, datagram=cell.datagram, mode=mode_of(cell.mode))
    return deliver(link, messages, cell.body_size, random.Random(own), LIMIT_NANOS)


def mode_of(name: str) -> Mode | None:
    """Return the mode that a name of `MODES` stands for."""
    return parse_mode(MODES[name])


def promised(cell: Cell) -> float | None:
    """Return the share of messages that is to arrive at least, where one is promised."""
    if cell.mode == "fec" and cell.parts != 64:
        return None
    if cell.mode == "resend" and not cell.loss:
        return 1.0
    return REPAIRED.get((cell.mode, cell.loss, cell.burst))


def expected(cell: Cell) -> float | None:
    """Return the probability that a message arrives, where theory says one.

    Without repair all parts must: (1-p)^parts, and in bursts, a Markov chain of two states, the
    first part must find the good state and the others stay there. With a code, as many symbols
    as there are parts; RaptorQ needs one more in about 1 % of the cases in which exactly as many
    arrive.
    """
    mode = mode_of(cell.mode)
    if mode is None:
        return at_most_lost(cell, cell.parts, 0)
    if isinstance(mode, Fec):
        repair = repair_count(cell.parts, mode.share)
        return at_most_lost(cell, cell.parts + repair, repair)
    return None


def at_most_lost(cell: Cell, count: int, most: int) -> float:
    """Return the probability that of `count` datagrams in a row at most so many are lost."""
    begins = cell.impairment.chance_of_burst() if cell.burst else cell.loss
    goes_on = 1 - 1 / cell.burst if cell.burst else cell.loss
    # By the number lost so far: the probability, and that the last one arrived, or was lost.
    arrived, lost = [1 - cell.loss] + [0.0] * most, [0.0] * (most + 2)
    lost[1] = cell.loss
    for _ in range(count - 1):
        now_arrived = [
            arrived[number] * (1 - begins) + lost[number] * (1 - goes_on)
            for number in range(most + 1)
        ]
        now_lost = [
            arrived[number - 1] * begins + lost[number - 1] * goes_on
            for number in range(1, most + 1)
        ]
        arrived, lost = now_arrived, [0.0, *now_lost, 0.0]
    return min(1.0, sum(arrived) + sum(lost[: most + 1]))


def spread(cell: Cell) -> float:
    """Return how much larger the variance of the share is than that of independent messages.

    In bursts a message shares its fate with the next one: the states of the chain so many
    datagrams apart are correlated, and those sums are a geometric series.
    """
    if not cell.burst:
        return 1.0
    mode = mode_of(cell.mode)
    repair = repair_count(cell.parts, mode.share) if isinstance(mode, Fec) else 0
    stays = 1 - 1 / cell.burst - cell.impairment.chance_of_burst()
    alike: float = stays ** (cell.parts + repair)
    return (1 + alike) / (1 - alike)


def matrix(shapes: tuple[tuple[DatagramSize, int], ...] = SHAPES) -> Iterator[Cell]:
    """Yield every cell; a link without loss has no bursts."""
    for mode in MODES:
        for datagram, parts in shapes:
            for loss in (0.0, 0.001, 0.01, 0.05, 0.1):
                for burst in (0.0, 5.0) if loss else (0.0,):
                    yield Cell(loss, burst, datagram, parts, mode)


def verdict(cell: Cell, outcome: Outcome) -> str:
    """Return what of an outcome is not as it should be; nothing when all is.

    Shares may be off by `SIGMAS` standard deviations, and by one message where they are so near to
    0 or 1 that the distribution is Poisson's.
    """
    wrong = []
    if outcome.different:
        wrong.append(f"{outcome.different} DIFFER")
    theory = expected(cell)
    if theory is not None:
        deviation = math.sqrt(outcome.sent * theory * (1 - theory) * spread(cell))
        if abs(outcome.delivered - outcome.sent * theory) > SIGMAS * deviation + 1:
            wrong.append("NOT BY THEORY")
    least = promised(cell)
    if least is not None:
        arrived = outcome.delivered if cell.mode == "fec" else outcome.in_time
        if arrived < math.floor(outcome.sent * least):
            wrong.append(f"BELOW {least:.2%}")
    return ", ".join(wrong)


def main() -> int:
    """Print the table; 1 when something is not as it should be."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.loss")
    parser.add_argument("--messages", type=int, default=1000, help="of each row (1000)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--mode", choices=MODES, help="measure this mode only")
    parser.add_argument("--loss", type=float, help="measure this loss only")
    parser.add_argument("--parts", type=int, help="measure messages of this many parts only")
    parser.add_argument("--datagram", help="measure this datagram size only")
    parser.add_argument(
        "--promised", action="store_true", help="measure only rows with a documented claim"
    )
    parser.add_argument("--large", action="store_true", help="64 parts of large datagrams instead")
    arguments = parser.parse_args()
    wanted = {
        name: getattr(arguments, name)
        for name in ("mode", "loss", "parts", "datagram")
        if getattr(arguments, name) is not None
    }
    cells = [
        cell
        for cell in matrix(LARGE if arguments.large else SHAPES)
        if all(str(getattr(cell, name)) == str(value) for name, value in wanted.items())
        and (not arguments.promised or (promised(cell) and cell.loss))
    ]
    started = time.monotonic()
    print(HEAD)
    bad = 0
    for number, cell in enumerate(cells, start=1):
        if sys.stderr.isatty():
            print(f"row {number} of {len(cells)}...", end="\r", file=sys.stderr, flush=True)
        outcome = run(cell, arguments.messages, seed=arguments.seed)
        wrong = verdict(cell, outcome)
        bad += bool(wrong)
        print(row(cell, outcome), wrong, flush=True)
    print(f"{len(cells)} rows in {time.monotonic() - started:.0f} s, {bad} not as they should be")
    return min(1, bad)


HEAD = (
    "mode   datagram parts   loss burst      delivered  in time   theory"
    "   age p50       p99 overhead"
)


def row(cell: Cell, outcome: Outcome) -> str:
    """Return a line of the table."""
    theory = expected(cell)
    ages = outcome.ages_nanos or [0]
    p50, p99 = (ages[int(share * (len(ages) - 1))] / 1e6 for share in (0.5, 0.99))
    overhead = outcome.sent_bytes / (outcome.sent * cell.body_size) - 1
    return (
        f"{cell.mode:6} {cell.datagram!s:8} {cell.parts:5} {cell.loss:6.1%} {cell.burst or 1:5.0f}"
        f" {outcome.delivered:6} of {outcome.sent:5} {outcome.in_time / outcome.sent:8.3%}"
        f" {'' if theory is None else format(theory, '.3%'):>8}"
        f" {p50:6.1f} ms {p99:6.1f} ms {overhead:8.1%}"
    )


if __name__ == "__main__":
    sys.exit(main())
