# SPDX-License-Identifier: Apache-2.0
"""Which solution a receiver has, by satellites and lock times; latency that varies; replay."""

import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from groundlink.core.clock import NANOS
from groundlink.messages.base import encode
from services.sensors.gnss.checks import problems
from services.sensors.gnss.fix_state import FixState
from services.sensors.gnss.model import GnssModel
from services.sensors.gnss.reception import Signals
from services.sensors.gnss.sky import directions
from services.sensors.gnss.spec import Gnss, Multipath, PositionNoise, Solution, Walker
from tests.services.sensors.gnss.test_model import UP, fixes, receiver
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.states import EPOCH_NANOS
from tests.services.sensors.yards import box, moving, resting, yard

LADDER = (
    Solution("single_point", 4, 1.0, PositionNoise(1.0)),
    Solution("sbas", 5, 3.0, PositionNoise(0.5)),
    Solution("rtk_float", 5, 4.0, PositionNoise(0.1)),
    Solution("rtk_fix", 6, 6.0, PositionNoise(0.01)),
)

# A letter a satellite: d direct, r reflected only, . not received. One row a second.
COURSE = (
    *(("dddddd", None),) * 1,
    *(("dddddd", "single_point"),) * 2,
    *(("dddddd", "sbas"),) * 1,
    *(("dddddd", "rtk_float"),) * 2,
    *(("dddddd", "rtk_fix"),) * 3,
    # One satellite is interrupted: five remain, and the sixth must wait again.
    *(("ddddd.", "rtk_float"),) * 1,
    *(("dddddd", "rtk_float"),) * 6,
    *(("dddddd", "rtk_fix"),) * 1,
    # Two are received by reflections: not by carrier, and for a second by nothing at all.
    *(("ddddrr", "single_point"),) * 3,
    *(("ddddrr", "sbas"),) * 1,
    # All are lost, such as under a bridge: from the beginning.
    *(("......", None),) * 2,
    *(("dddd..", None),) * 1,
    *(("dddd..", "single_point"),) * 5,
    *(("dddddd", "single_point"),) * 3,
    *(("dddddd", "sbas"),) * 1,
    *(("dddddd", "rtk_float"),) * 2,
    *(("dddddd", "rtk_fix"),) * 2,
)

SATELLITES = ((0, 80), (20, 30), (90, 25), (150, 40), (220, 20), (300, 50))


def signals(letters: str) -> Signals:
    path = np.array([".dr".index(letter) for letter in letters])
    return Signals(directions(SATELLITES), path, np.full(len(path), np.inf))


def test_a_course_of_signals_gives_these_solutions() -> None:
    state = FixState(LADDER, len(SATELLITES))
    types = []
    for second, (letters, _) in enumerate(COURSE):
        found = state.take(second * NANOS, signals(letters))
        types.append(None if found is None else LADDER[found.rank].type)
    assert types == [expected for _, expected in COURSE]


def test_a_solution_also_uses_satellites_that_are_too_young_to_reach_it() -> None:
    """Seven satellites for 9 s, of which one is interrupted after 6 s."""
    state = FixState(LADDER, 7)
    sky = directions((*SATELLITES, (260, 60)))
    for second in range(9):
        path = np.ones(7, np.int64)
        path[6] = second != 6
        found = state.take(second * NANOS, Signals(sky, path, np.full(7, np.inf)))
        used = 0 if found is None else np.count_nonzero(found.used)
        # It needs a second, as the first solution does, and not the 6 s of the last.
        assert used == (0 if second == 0 else 6 if second in (6, 7) else 7)
    assert found is not None
    assert LADDER[found.rank].type == "rtk_fix"


def test_memory_continues_the_course() -> None:
    whole, first = FixState(LADDER, 6), FixState(LADDER, 6)
    for second, (letters, _) in enumerate(COURSE):
        successor = FixState(LADDER, 6)
        successor.remember(first.memory())
        expected = whole.take(second * NANOS, signals(letters))
        for state in (first, successor):
            found = state.take(second * NANOS, signals(letters))
            assert (found and found.rank) == (expected and expected.rank)
    assert FixState(LADDER[:1], 6).memory()
    assert not FixState((Solution("rtk_fix"),), 6).memory()


def test_messages_follow_the_solution() -> None:
    roof = box("roof", (20, 20, 0.2), (16, 0, 4))
    model = receiver(
        yard(roof), mount=UP, sky_view=True, rate_hz=2, solutions=LADDER, startup_s=1.0
    )
    x = np.clip(np.arange(400 * 26) / 400 - 8, 0, None) * 4  # under the roof from 9.5 to 14.5 s
    found: list[tuple[int, bytes, bytes, float]] = []
    for state in moving(np.stack([x, 0 * x, 0 * x], axis=1)):
        for fix in model.readings(state):
            gga, rmc, _ = (line.payload.split(b",") for line in model.datagrams(fix, 0))
            variance = np.frombuffer(fix.position_covariance_m2)[0]
            row = (fix.status, gga[6], rmc[12][:1], fix.covariance_type and variance)
            if not found or found[-1][:3] != row[:3]:
                found.append(row)
    none, single = (-1, b"0", b"N"), (0, b"1", b"A")
    climb = [none, single, (1, b"2", b"D"), (2, b"5", b"F"), (2, b"4", b"R")]
    order = [row[:3] for row in found]
    assert order[:5] == climb
    assert none in order[5:]  # under the roof
    assert order[-4:] == climb[1:]
    sigmas = np.sqrt([variance for *_, variance in found[1:5]])
    np.testing.assert_allclose(sigmas / sigmas[0], (1.0, 0.5, 0.1, 0.01))


def test_latency_varies_by_seed_and_never_swaps_fixes() -> None:
    def came(seed: int) -> list[tuple[int, int]]:
        model = receiver(yard(seed=seed), rate_hz=20, latency_s=0.02, latency_jitter_s=0.2)
        return [
            (fix.stamp_nanos - EPOCH_NANOS, state.tick)
            for state in resting(2000)
            for fix in model.readings(state)
        ]

    one, other = came(1), came(2)
    assert one == came(1) != other
    assert [stamp for stamp, _ in one] == [i * 50_000_000 for i in range(len(one))]
    assert all(before <= after for (_, before), (_, after) in pairwise(one))
    delays = np.array([tick * 2_500_000 - stamp for stamp, tick in one]) * 1e-9
    assert 0.02 <= delays.min() < 0.05
    assert 0.15 < delays.max() <= 0.2225


@pytest.mark.parametrize("name", ["gnss_zed_f9p", "gnss_neo_m8n"])
def test_a_receiver_in_a_yard_replays_to_the_byte_also_by_a_successor(name: str) -> None:
    made = yard(box("wall", (40, 0.2, 20), (0, 6, 5)), box("roof", (5, 5, 0.2), (9, 0, 4)))
    spec = from_sheet(Gnss, name, mount=UP, startup_s=0.4)
    ticks = np.arange(400 * 18)
    states = list(moving(np.stack([ticks / 400, 0 * ticks, 0 * ticks], axis=1)))

    def model() -> GnssModel:
        return GnssModel(made, made.vehicles[0], spec)

    def sent(one: GnssModel, part: list[Any]) -> dict[int, bytes]:
        return {fix.stamp_nanos: encode(fix) for fix in fixes(one, part)}

    first, half = model(), 400 * 9 + 17
    whole = sent(model(), states)
    before = sent(first, states[:half])
    successor = model()
    successor.remember(first.memory())
    assert before | sent(successor, states[first.settled_tick() :]) == whole
    forgetful = sent(model(), states[first.settled_tick() :])
    assert forgetful.items() - whole.items(), "locks are not needed"


@pytest.mark.parametrize(
    ("fields", "path", "text"),
    [
        ({"multipath": Multipath()}, ("multipath",), "sky_view: true"),
        (
            {"constellations": (Walker("gps", 24, 5, 1, 55, 26560),)},
            ("constellations", 0, "planes"),
            "24 satellites .* divisor",
        ),
        (
            {"constellations": (Walker("gps", 24, 6, 6, 55, 26560),)},
            ("constellations", 0, "phasing"),
            r"less than `planes` \(6\), got 6",
        ),
        (
            {"solutions": LADDER, "satellites_needed": 5},
            ("satellites_needed",),
            "`solutions` replaces `satellites_needed`",
        ),
        ({"solutions": LADDER}, None, ""),
    ],
)
def test_options_that_contradict_each_other_are_reported(
    fields: dict[str, Any], path: tuple[str | int, ...] | None, text: str
) -> None:
    spec = Gnss("gnss", "/fix", "gnss_link", **fields)
    found = list(problems(spec, yard().vehicles[0], yard()))
    assert [problem.path for problem in found] == ([] if path is None else [path])
    for problem in found:
        assert re.search(text, problem.text)
