# SPDX-License-Identifier: Apache-2.0
"""Where actors are: on their way, in time, and without a jump."""

from math import degrees, dist, hypot, inf, pi

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from groundlink.world.actor_motion import TURN_RADPS, ActorPose, initial_pose, mover
from groundlink.world.actors import (
    FreeMotion,
    HingeMotion,
    PathMotion,
    PersonForm,
    Swing,
    form_solids,
)
from groundlink.world.bounds import bounds
from groundlink.world.terrain import Ground

LINE = PathMotion(points_m=((0.0, 0.0), (3.0, 4.0)), speed_mps=2.0, pause_s=0.5, start_s=1.0)
SQUARE = PathMotion(
    points_m=((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)), speed_mps=1.0, closed=True
)
SWINGS = (Swing(at_s=2.0, angle_deg=90.0, for_s=2.0), Swing(at_s=6.0, angle_deg=0.0))
DOOR = HingeMotion(at_m=(1.0, 2.0, 0.1), yaw_deg=30.0, swings=SWINGS)


def slope() -> Ground:
    """Return ground that rises by 0.1 towards the east, from x = -10 on."""
    heights = np.tile(np.arange(21, dtype=np.float32) / 10, (21, 1))
    return Ground(heights, np.zeros((20, 20), np.uint8), 1.0, -10.0, -10.0, ("soil",))


@pytest.mark.parametrize(
    ("seconds", "at", "yaw_deg"),
    [
        (0.0, (0.0, 0.0), 53.13),
        (1.0, (0.0, 0.0), 53.13),
        (2.25, (1.5, 2.0), 53.13),
        (3.5, (3.0, 4.0), 53.13),  # there, and waits
        (4.0, (3.0, 4.0), 53.13),
        (4.5, (3.0, 4.0), 143.13),  # turns about in a second
        (5.0 + 1.25, (1.5, 2.0), -126.87),
        (1.0 + 2 * 4.0 + 1.25, (1.5, 2.0), 53.13),
    ],
)
def test_goes_there_and_back(seconds: float, at: tuple[float, float], yaw_deg: float) -> None:
    place = mover(LINE, None).at(seconds)
    assert place.position_m == pytest.approx((*at, 0.0), abs=1e-9)
    assert (degrees(place.yaw_rad) - yaw_deg + 180) % 360 - 180 == pytest.approx(0, abs=0.01)


def test_goes_round() -> None:
    # Four sides of 2 s, four quarter turns of half a second.
    walk = mover(SQUARE, None)
    assert walk.at(2.0 + 0.5 + 1.0).position_m == pytest.approx((2.0, 1.0, 0.0))
    assert walk.at(9.0).position_m == pytest.approx((0.0, 1.0, 0.0), abs=1.0)
    assert walk.at(10.0 + 1.0).position_m == pytest.approx((1.0, 0.0, 0.0))


def test_goes_over_hill_and_dale() -> None:
    walk = mover(PathMotion(points_m=((-5.0, 0.0), (5.0, 0.0)), speed_mps=1.0, z_m=0.2), slope())
    assert walk.at(0.0).position_m[2] == pytest.approx(0.7, abs=1e-6)
    assert walk.at(7.5).position_m[2] == pytest.approx(1.45, abs=1e-6)


@pytest.mark.parametrize(
    ("seconds", "open_deg"),
    [(0.0, 0.0), (2.0, 0.0), (3.0, 45.0), (4.0, 90.0), (5.9, 90.0), (6.5, 45.0), (9.0, 0.0)],
)
def test_a_door_opens_and_shuts_in_time(seconds: float, open_deg: float) -> None:
    place = mover(DOOR, None).at(seconds)
    assert place.position_m == DOOR.at_m
    assert degrees(place.yaw_rad) == pytest.approx(30.0 + open_deg)


def test_a_door_may_swing_for_ever() -> None:
    always = msgspec.structs.replace(DOOR, every_s=10.0)
    assert mover(always, None).at(73.0) == mover(DOOR, None).at(3.0)


coordinates = st.integers(-20, 20).map(float)
points = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=6)


@st.composite
def walks(draw: st.DrawFn) -> PathMotion:
    way = draw(
        points.filter(lambda p: all(dist(a, b) > 0 for a, b in zip(p, p[1:] + p[:1], strict=True)))
    )
    return PathMotion(
        points_m=tuple(way),
        speed_mps=draw(st.floats(0.1, 5.0)),
        closed=draw(st.booleans()),
        pause_s=draw(st.sampled_from([0.0, 0.3])),
    )


@given(walks(), st.floats(0.0, 1000.0), st.floats(1e-3, 0.05))
def test_nobody_jumps(along: PathMotion, seconds: float, after: float) -> None:
    walk = mover(along, None)
    first, second = walk.at(seconds), walk.at(seconds + after)
    moved = hypot(*np.subtract(second.position_m, first.position_m))
    assert moved <= along.speed_mps * after * (1 + 1e-6) + 1e-9
    turned = abs((second.yaw_rad - first.yaw_rad + pi) % (2 * pi) - pi)
    assert turned <= TURN_RADPS * after * (1 + 1e-6) + 1e-9


@given(walks(), st.floats(0.0, 1000.0))
def test_everybody_stays_on_the_way(along: PathMotion, seconds: float) -> None:
    way = [*along.points_m, *along.points_m[:1]] if along.closed else along.points_m
    at = np.array(mover(along, None).at(seconds).position_m[:2])
    nearest = inf
    for a, b in zip(np.array(way)[:-1], np.array(way)[1:], strict=True):
        share = np.clip((at - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        nearest = min(nearest, float(np.linalg.norm(a + share * (b - a) - at)))
    assert nearest < 1e-9


def test_what_is_free_starts_on_the_ground() -> None:
    place = initial_pose(FreeMotion(at_m=(5.0, 0.0, 0.25), yaw_deg=180.0, mass_kg=1.0), slope())
    assert place == ActorPose(pytest.approx((5.0, 0.0, 1.75), abs=1e-6), pytest.approx(pi))


HINGE = {"kind": "hinge", "at_m": [0, 0, 0]}
OPEN = {"at_s": 1, "angle_deg": 9}


@pytest.mark.parametrize(
    ("fields", "problem"),
    [
        ({"kind": "along", "points_m": [[0, 0], [0, 0]]}, "are equal"),
        ({"kind": "along", "points_m": [[0, 0], [1, 0], [0, 0]], "closed": True}, "are equal"),
        ({**HINGE, "swings": [OPEN, {"at_s": 1.5, "angle_deg": 0}]}, "overlap"),
        ({**HINGE, "swings": [OPEN], "every_s": 1.5}, "shorter than all"),
        ({**HINGE, "swings": [OPEN], "every_s": 5}, "end at `start_deg`"),
    ],
)
def test_what_makes_no_motion_is_refused(fields: dict[str, object], problem: str) -> None:
    with pytest.raises(msgspec.ValidationError, match=problem):
        msgspec.convert(fields, PathMotion | HingeMotion)


def test_a_person_twice_as_tall_is_twice_as_large_in_every_direction() -> None:
    small, large = (
        PersonForm(height_m=height, shirt="a", trousers="a", skin="a") for height in (1.0, 2.0)
    )
    boxes = [np.array([bounds(part) for part in form_solids(person)]) for person in (small, large)]
    np.testing.assert_allclose(2 * boxes[0], boxes[1], atol=1e-9)
