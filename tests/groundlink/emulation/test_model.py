# SPDX-License-Identifier: Apache-2.0
"""The model against theory: shares, bursts, times, and counts that add up. All seeded."""

import math
import random
from itertools import groupby, pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.emulation.model import OUTCOMES, OVERHEAD_BYTES, WAITING_BYTES, LinkDirection
from groundlink.emulation.settings import Impairment

MS = 1_000_000
COUNT = 40_000
SIGMAS = 4.0


def way(*, seed: int = 1, direction: str = "to_ros", flips: bool = False, **fields: float | bool):  # type: ignore[no-untyped-def]
    return LinkDirection[int](Impairment(**fields), seed=seed, direction=direction, flips=flips)  # type: ignore[arg-type]


def drain(one_way: LinkDirection[int], until_nanos: int = 1 << 62) -> list[tuple[int, bytes, int]]:
    return list(iter(lambda: one_way.take(until_nanos), None))


def run(
    one_way: LinkDirection[int], count: int = COUNT, size: int = 8, period: int = MS
) -> list[int]:
    """Send `count` datagrams a period apart; return the indices in the order of delivery."""
    arrived = []
    for index in range(count):
        one_way.put(bytes(size), index, index * period)
        arrived += [tag for _, _, tag in drain(one_way, index * period)]
    return arrived + [tag for _, _, tag in drain(one_way)]


def adds_up(one_way: LinkDirection[int]) -> bool:
    counts = one_way.counts
    offered = counts["datagrams"] + counts["duplicated"]
    return offered == sum(counts[outcome] for outcome in OUTCOMES) + one_way.waiting


def agrees(count: int, share: float, total: int) -> bool:
    """Whether a count agrees with its binomial distribution."""
    return abs(count - share * total) <= SIGMAS * math.sqrt(total * share * (1 - share))


def test_by_default_nothing_happens() -> None:
    one_way = way()
    assert run(one_way, 100) == list(range(100))
    assert {name: n for name, n in one_way.counts.items() if n} == {
        "datagrams": 100,
        "delivered": 100,
    }
    one_way.put(b"abc", 7, 500)
    assert one_way.take(500) is None  # order is kept: the one before arrived at 99 ms
    assert one_way.take(99 * MS) == (99 * MS, b"abc", 7)


@pytest.mark.parametrize("share", [0.001, 0.01, 0.05, 0.1, 0.5])
@pytest.mark.parametrize(
    ("field", "count"), [("loss", "lost"), ("duplicate", "duplicated"), ("reorder", "reordered")]
)
def test_independent_shares(field: str, count: str, share: float) -> None:
    one_way = way(**{field: share})
    arrived = run(one_way)
    assert agrees(one_way.counts[count], share, COUNT)
    assert adds_up(one_way)
    assert len(arrived) == COUNT - one_way.counts["lost"] + one_way.counts["duplicated"]


@pytest.mark.parametrize(("share", "burst"), [(0.05, 5.0), (0.01, 3.0), (0.2, 20.0), (0.05, 1.0)])
def test_bursts_have_their_mean_length_and_share(share: float, burst: float) -> None:
    one_way = way(loss=share, burst=burst)
    there = set(run(one_way))
    is_lost = [index not in there for index in range(COUNT)]
    lengths = [len(list(group)) for lost, group in groupby(is_lost) if lost]
    # Lengths are geometric: variance burst * (burst - 1). The share's variance is that of a
    # two-state chain, whose correlation time is about (1 + k) / (1 - k), k = 1 - p - r.
    deviation = math.sqrt(burst * (burst - 1) / len(lengths))
    assert abs(sum(lengths) / len(lengths) - burst) <= SIGMAS * deviation + 1e-12
    k = 1 - share / (1 - share) / burst - 1 / burst
    spread = math.sqrt(share * (1 - share) * (1 + k) / (1 - k) / COUNT)
    assert abs(sum(is_lost) / COUNT - share) <= SIGMAS * spread
    assert adds_up(one_way)


def test_independent_loss_has_no_memory() -> None:
    there = set(run(way(loss=0.2)))
    behind_lost = [i + 1 in there for i in range(COUNT - 1) if i not in there]
    assert agrees(behind_lost.count(False), 0.2, len(behind_lost))


def test_bit_errors_depend_on_the_size() -> None:
    for size in (100, 1400, 10_000):
        one_way = way(bit_errors=1e-5)
        run(one_way, 5000, size)
        assert agrees(one_way.counts["corrupted"], 1 - (1 - 1e-5) ** (8 * size), 5000)
        assert adds_up(one_way)


def test_with_a_key_wrong_bits_arrive() -> None:
    one_way = way(bit_errors=1e-3, flips=True)
    for index in range(2000):
        one_way.put(bytes(1000), index, 0)
    arrived = drain(one_way)
    wrong = [sum(map(int.bit_count, datagram)) for _, datagram, _ in arrived]
    assert len(arrived) == 2000
    assert one_way.counts["corrupted"] == 0
    assert one_way.counts["flipped"] == sum(count > 0 for count in wrong)
    assert agrees(sum(wrong), 1e-3, 2000 * 8000)
    assert adds_up(one_way)


def test_certain_bit_errors_flip_everything() -> None:
    one_way = way(bit_errors=1.0, flips=True)
    one_way.put(b"\x00\xff", 0, 0)
    assert drain(one_way)[0][1] == b"\xff\x00"


def test_delay_and_jitter() -> None:
    one_way = way(delay_ms=10, jitter_ms=4)
    delays = []
    for index in range(2000):
        one_way.put(b"", index, index * 10 * MS)
    for due, _, index in drain(one_way):
        delays.append(due - index * 10 * MS)
    assert min(delays) >= 10 * MS
    assert max(delays) < 14 * MS
    mean, deviation = sum(delays) / 2000, 4 * MS / math.sqrt(12 * 2000)
    assert abs(mean - 12 * MS) < SIGMAS * deviation
    assert one_way.counts["delayed"] == 2000


def test_jitter_changes_no_order_and_reordering_does() -> None:
    assert run(way(delay_ms=10, jitter_ms=50), 2000) == list(range(2000))
    one_way = way(reorder=0.1, reorder_ms=5)
    arrived = run(one_way, 2000)
    overtaken = sum(a > b for a, b in pairwise(arrived))
    assert sorted(arrived) == list(range(2000))
    assert 0 < overtaken <= one_way.counts["reordered"]
    assert agrees(one_way.counts["reordered"], 0.1, 2000)


def test_rate_and_queue() -> None:
    one_way = way(rate_mbps=8, queue_kb=10)  # a byte a microsecond
    for index in range(30):
        one_way.put(bytes(1000), index, 0)
    arrived = drain(one_way)
    # One is on the wire, ten wait for it, the rest finds no room.
    assert [due for due, _, _ in arrived] == [(i + 1) * MS for i in range(10)]
    assert one_way.counts["rate_limited"] == 20
    one_way.put(bytes(1000), 99, 9 * MS)
    assert drain(one_way)[0][0] == 11 * MS
    assert adds_up(one_way)


def test_a_datagram_larger_than_the_queue_passes_when_it_is_empty() -> None:
    one_way = way(rate_mbps=8, queue_kb=1)
    one_way.put(bytes(60_000), 0, 0)
    one_way.put(bytes(60_000), 1, 60 * MS)
    assert [due for due, _, _ in drain(one_way)] == [60 * MS, 120 * MS]


def test_the_rate_is_that_of_the_long_run() -> None:
    one_way = way(rate_mbps=80, loss=0.1)
    arrived = run(one_way, 20_000, size=2000, period=MS // 10)  # twice what the link carries
    carried = one_way.counts["lost"] + len(arrived)
    assert carried * 2000 == pytest.approx(2.0 * 80e6 / 8, rel=0.02)
    assert agrees(one_way.counts["lost"], 0.1, carried)
    assert adds_up(one_way)


def test_an_outage_lets_nothing_in_and_what_is_under_way_out() -> None:
    one_way = way(delay_ms=10)
    one_way.put(b"a", 0, 0)
    one_way.settings = Impairment(outage=True)
    one_way.put(b"b", 1, MS)
    assert [tag for _, _, tag in drain(one_way)] == [0]
    assert one_way.counts["outage"] == 1
    assert adds_up(one_way)


def test_memory_is_bounded() -> None:
    one_way = way(delay_ms=1000)
    for index in range(1500):
        one_way.put(bytes(65_507), index, 0)
        assert one_way.waiting_bytes <= WAITING_BYTES
    assert one_way.waiting == WAITING_BYTES // (65_507 + OVERHEAD_BYTES)
    assert one_way.counts["overflow"] == 1500 - one_way.waiting
    assert adds_up(one_way)
    drain(one_way)
    assert one_way.waiting_bytes == 0


BAD = {"loss": 0.1, "burst": 3.0, "duplicate": 0.1, "reorder": 0.1, "bit_errors": 1e-4}


def test_the_same_seed_does_the_same_whenever_datagrams_come() -> None:
    def outcomes(period: int, **more: int) -> list[tuple[int, bytes]]:
        one_way = way(flips=True, **BAD, **more)  # type: ignore[arg-type]
        for index in range(3000):
            one_way.put(bytes(500), index, index * period)
        return sorted((tag, datagram) for _, datagram, tag in drain(one_way))

    assert outcomes(1) == outcomes(7 * MS)
    assert outcomes(1) != outcomes(1, seed=2)


def test_directions_are_independent() -> None:
    there = set(run(way(loss=0.5), 4000))
    back = set(run(way(loss=0.5, direction="from_ros"), 4000))
    assert agrees(len(there & back), 0.25, 4000)


@given(st.integers(0, 2**32), st.data())
def test_counts_add_up_whatever_is_set(seed: int, data: st.DataObject) -> None:
    share = st.sampled_from([0.0, 0.1, 0.4, 1.0])
    rng = random.Random(seed)
    one_way = way(seed=seed, flips=data.draw(st.booleans()))
    now = 0
    for index in range(200):
        if index % 50 == 0:
            one_way.settings = Impairment(
                loss=data.draw(st.sampled_from([0.0, 0.3])),
                burst=data.draw(st.sampled_from([0.0, 1.0, 4.0])),
                duplicate=data.draw(share),
                reorder=data.draw(share),
                delay_ms=data.draw(st.sampled_from([0.0, 3.0])),
                jitter_ms=data.draw(st.sampled_from([0.0, 3.0])),
                rate_mbps=data.draw(st.sampled_from([0.0, 1.0])),
                queue_kb=1,
                bit_errors=data.draw(st.sampled_from([0.0, 1e-3])),
                outage=data.draw(st.booleans()),
            )
        now += rng.randrange(MS)
        one_way.put(rng.randbytes(rng.randrange(300)), index, now)
        assert adds_up(one_way)
        if index % 3 == 0:
            drain(one_way, now)
            assert adds_up(one_way)
    drain(one_way)
    assert adds_up(one_way)
    assert one_way.waiting == one_way.waiting_bytes == 0


def test_another_link_goes_on_with_the_numbers_of_the_first() -> None:
    settings = {"loss": 0.3, "burst": 3.0, "duplicate": 0.1}
    whole, first, second = (way(**settings) for _ in range(3))
    expected = run(whole, 2000)
    arrived = run(first, 1234)
    second.state = first.state
    for index in range(1234, 2000):
        second.put(bytes(8), index, index * MS)
        arrived += [tag for _, _, tag in drain(second)]
    assert arrived == expected
    assert adds_up(second)
