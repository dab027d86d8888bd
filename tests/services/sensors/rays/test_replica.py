# SPDX-License-Identifier: Apache-2.0
"""The world around a ray sensor, made from a scenario and moved by states."""

import numpy as np
import pytest

from groundlink.messages.base import BadBusMessage
from groundlink.scenario.every_sensor import Mount
from services.sensors.rays.replica import Replica
from tests.services.sensors.lidar import rooms

DOWN = np.array([[0], [0], [-1]], np.float32)
NOW = np.zeros(1, np.float32)


def height(replica: Replica, x: float, y: float) -> tuple[float, int, int]:
    """Look straight down from 2.5 m: height, body and label of what is seen."""
    hits = replica.scene.cast(np.array([[x], [y], [2.5]], np.float32), DOWN, NOW, 10.0)
    return 2.5 - float(hits.range_m[0]), int(hits.body[0]), int(hits.label[0])


def replica(**visuals: object) -> Replica:
    scenario = rooms.scenario(visuals=[{"name": n, **v} for n, v in visuals.items()])  # type: ignore[dict-item]
    made = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    for state in rooms.states(scenario, lambda t: ((1.0, 0.5, 0.2), (0, 0, np.pi / 2)), 2):
        made.take(state)
    made.scene.move(made.motion(0, 1))
    return made


BOX = {"shape": {"kind": "box", "size_m": [0.4, 0.2, 0.1]}, "material": "dark"}


def test_links_follow_the_state() -> None:
    seen = replica(hull=BOX)
    # The vehicle has turned left by a right angle: its x is the world's y.
    assert height(seen, 1.0, 0.65) == (pytest.approx(0.25, abs=1e-5), 0, 6)
    assert height(seen, 1.15, 0.5) == (pytest.approx(0.0, abs=1e-5), -1, 4)


def test_wheels_are_cylinders_about_y() -> None:
    seen = replica(hull=BOX)
    # Wheel 0 is 0.3 m ahead of the base and 0.1 m to its left, radius 0.1 m, 0.06 m wide.
    top, body, label = height(seen, 0.9, 0.8)
    assert (round(top, 3), body, label) == (0.3, 1, 7)
    assert height(seen, 0.925, 0.8)[1] == 1
    assert height(seen, 0.935, 0.8)[1] == -1
    assert height(seen, 0.9, 0.89)[1] == 1
    assert seen.reflectivity[[4, 6, 7]] == pytest.approx([0.4, 0.1, 0.05])


def test_sensor_housing_is_excluded() -> None:
    puck = {"kind": "cylinder", "radius_m": 0.05, "length_m": 0.08}
    for z, seen_height in ((0.5, 0.25), (0.4, 0.64)):
        housing = {"shape": puck, "material": "dark", "position_m": [0.0, 0.0, z]}
        assert height(replica(hull=BOX, housing=housing), 1.0, 0.5)[0] == pytest.approx(
            seen_height, abs=1e-5
        )


@pytest.mark.parametrize(
    ("shape", "inside"),
    [
        ({"kind": "box", "size_m": [0.2, 0.4, 0.2]}, True),
        ({"kind": "box", "size_m": [0.4, 0.2, 0.2]}, False),
        ({"kind": "cylinder", "radius_m": 0.11, "length_m": 0.3}, True),
        ({"kind": "cylinder", "radius_m": 0.1, "length_m": 0.3}, False),
        ({"kind": "sphere", "radius_m": 0.11}, True),
        ({"kind": "sphere", "radius_m": 0.1}, False),
    ],
)
def test_enclosure_is_tested_by_shape(shape: dict[str, object], inside: bool) -> None:
    # 0.12 m below the sensor's height in the base, turned about x by a right angle, 0.105 m off.
    turned = {"orientation": [0.5**0.5, 0.0, 0.0, 0.5**0.5]}
    visual = {"shape": shape, "material": "dark", "position_m": [0.0, 0.0, 0.5 - 0.105], **turned}
    without = replica(thing=visual).reflectivity
    assert len(without) == (9 if inside else 10)


def test_a_state_without_a_link_is_refused() -> None:
    scenario = rooms.scenario()
    made = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    (state,) = rooms.states(scenario, rooms.at_rest, 1, links=1)
    with pytest.raises(BadBusMessage, match=r"tick 0: expected 4 link poses of `rover`"):
        made.take(state)


def test_motion_follows_the_states_taken() -> None:
    scenario = rooms.scenario()
    made = Replica(scenario, scenario.vehicles[0], Mount((0.0, 0.0, 0.5)))
    way = rooms.driving(speed_mps=1.0, turn_radps=0.5)
    for state in rooms.states(scenario, way, 30, first_tick=10):
        made.take(state)
    made.forget(5)
    made.forget(15)
    motion = made.motion(20, 25)
    assert motion.shape == (6, 4, 7)
    np.testing.assert_allclose(motion[3, 0, :3], way(23 * 0.0025)[0], atol=1e-12)
    made.forget(1000)
    for state in rooms.states(scenario, way, 5, first_tick=40):
        made.take(state)
    np.testing.assert_allclose(made.motion(41, 42)[0, 0, :3], way(41 * 0.0025)[0], atol=1e-12)
