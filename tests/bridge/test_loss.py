# SPDX-License-Identifier: Apache-2.0
"""What arrives over lossy links, in seeded runs of virtual time: the gateway's main tests.

Where a share is compared with theory, it may be off by `SIGMAS` standard deviations of its
binomial distribution; with the matrix as large as it is, an honest one would fail about once in
300 seeds, and the seed is fixed. `python -m benchmarks.loss` runs the same with more messages.
"""

from __future__ import annotations

import importlib.util
import math
import random

import pytest

from benchmarks.loss import MODES, Cell, Outcome, deliver, expected, matrix, mode_of, run
from benchmarks.virtual_link import NANOS, VirtualLink
from groundlink.emulation import Impairment

from .programs import missing

SEED = 1
SIGMAS = 4.0
MESSAGES = {256: 40, "mtu": 80, "loopback": 60}
LIMIT_NANOS = NANOS // 2
"""Of `resend`, as the table of modes has it."""


def need_code(mode: str) -> None:
    if mode == "fec" and importlib.util.find_spec("raptorq") is None:
        missing("raptorq is not installed: pip install udp-bridge[fec]")


def check_share(outcome: Outcome, probability: float) -> None:
    mean = outcome.sent * probability
    # The last one is for shares so near to 1 or 0 that the distribution is Poisson's.
    bound = SIGMAS * math.sqrt(mean * (1 - probability)) + 1
    assert abs(outcome.delivered - mean) <= bound, (outcome.delivered, mean, bound)


@pytest.mark.parametrize("cell", list(matrix()), ids=lambda cell: "-".join(map(str, cell)))
def test_matrix(cell: Cell) -> None:
    need_code(cell.mode)
    outcome = run(cell, MESSAGES[cell.datagram], seed=SEED)
    assert outcome.different == 0
    probability = expected(cell)
    if probability is not None:
        check_share(outcome, probability)
    if not cell.loss:
        assert outcome.delivered == outcome.sent


def test_without_repair_the_share_is_that_of_theory_over_many_messages() -> None:
    for loss in (0.01, 0.05):
        cell = Cell(loss, 0.0, "mtu", "none")
        check_share(run(cell, 1000, seed=SEED + 1), (1 - loss) ** cell.parts)


def test_fec_of_a_fifth_brings_9999_of_10000_through_5_percent() -> None:
    need_code("fec")
    outcome = run(Cell(0.05, 0.0, 256, "fec"), 300, seed=SEED)
    assert (outcome.delivered, outcome.different) == (300, 0)


@pytest.mark.parametrize(("loss", "burst"), [(0.1, 0.0), (0.05, 5.0)])
def test_resend_brings_999_of_1000_through_in_time(loss: float, burst: float) -> None:
    outcome = run(Cell(loss, burst, "mtu", "resend"), 1000, seed=SEED)
    assert outcome.different == 0
    assert outcome.in_time == outcome.delivered
    assert outcome.in_time >= 999


@pytest.mark.parametrize("mode", MODES)
def test_everything_at_once_changes_no_byte(mode: str) -> None:
    need_code(mode)
    worst = Impairment(
        loss=0.02,
        burst=3,
        duplicate=0.1,
        reorder=0.1,
        reorder_ms=15,
        delay_ms=5,
        jitter_ms=20,
        bit_errors=1e-7,
        rate_mbps=50,
    )
    link = VirtualLink(worst, seed=SEED, mode=mode_of(mode))
    outcome = deliver(link, 300, 20_000, random.Random(SEED), LIMIT_NANOS)
    assert outcome.different == 0
    assert outcome.delivered > 200
    counts = link.there.counts
    happened = ("lost", "duplicated", "reordered", "corrupted", "delayed")
    assert all(counts[fate] for fate in happened), counts


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("size", [100, 20_000, 1_000_000])
def test_after_an_outage_the_newest_flow_and_no_backlog(mode: str, size: int) -> None:
    need_code(mode)
    fine = Impairment(delay_ms=10)
    link = VirtualLink(fine, seed=SEED, datagram="loopback", mode=mode_of(mode))
    rng = random.Random(SEED)
    for tick in range(60):
        if tick in (20, 40):
            link.impair(Impairment(outage=tick == 20, delay_ms=10))
            over_nanos = link.now_nanos
        link.send(rng.randbytes(size))
        link.advance(NANOS // 10)
    before, after = (
        [handed for handed in link.handed if (handed.at_nanos > over_nanos) == is_after]
        for is_after in (False, True)
    )
    assert len(before) == 20
    fresh = [handed for handed in after if handed.message.stamp_nanos >= over_nanos]
    assert fresh[0].at_nanos <= over_nanos + NANOS // 2
    assert len(fresh) >= 17
    # What the topic's own repair brings back is not stale by its limit; nothing else comes late.
    limit_nanos = LIMIT_NANOS if mode == "resend" else NANOS // 10
    assert all(at - message.stamp_nanos <= limit_nanos for message, at in after)
    if mode != "resend":
        stamps = [message.stamp_nanos for message, _ in link.handed]
        assert stamps == sorted(stamps)
