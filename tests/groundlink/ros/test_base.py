# SPDX-License-Identifier: Apache-2.0
"""What a base tells ROS, from messages that were made up."""

import math
import re
from collections.abc import Iterable
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import quaternion_from_rpy, transform
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import WheelEncoders, floats
from groundlink.messages.navigation import JointState, Odometry, Transform, Transforms
from groundlink.ros.base import Base, still_transforms
from groundlink.ros.streams import outgoing
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import TfTree

RUN = "r"
PERIOD = 20_000_000
NO_ERROR = memoryview(bytes(36 * 8))
SCENARIOS = sorted(path.stem for path in SHIPPED.glob("*.yaml"))


@cache
def shipped(name: str) -> Scenario:
    return load(name)


def of(name: str, **tf: object) -> tuple[Scenario, list[Base]]:
    scenario = shipped(name)
    vehicles = tuple(replace(v, tf=TfTree(**tf)) for v in scenario.vehicles)  # type: ignore[arg-type]
    scenario = replace(scenario, vehicles=vehicles)
    return scenario, [Base(scenario, vehicle, RUN) for vehicle in vehicles]


def odometry(
    stamp: int, x: float, yaw: float, *, frame: str = "odom", clock_error: int = 0
) -> Odometry:
    turned = quaternion_from_rpy(0, 0, yaw)
    still = (0.0, 0.0, 0.0)
    return Odometry(
        *(stamp, frame, "base_link", (x, 1.0, 0.0), turned, still, still, NO_ERROR, NO_ERROR),
        clock_error_nanos=clock_error,
    )


def told(base: Base, rows: Iterable[tuple[str, Odometry]]) -> list[Transform]:
    found = []
    for role, message in rows:
        for topic, transforms, _ in base.receive(base.keys[role], message):
            assert topic == "/tf"
            assert isinstance(transforms, Transforms)
            found += transforms.transforms
    return found


def joints(base: Base, ticks: Iterable[int], stamp: int) -> JointState:
    names = ("a",) * len(ticks := tuple(ticks))
    (row,) = base.receive(base.keys["encoders"], WheelEncoders(stamp, "base_link", names, ticks))
    assert row.topic == "/joint_states"
    assert isinstance(row.message, JointState)
    return row.message


def test_joints_turn_as_the_encoders_count() -> None:
    _, (base,) = of("indoor_paper")
    first = joints(base, (0, 0), 5)
    second = joints(base, (81920 // 40, -81920 // 80), 5 + PERIOD)
    assert not any(floats(first.velocities))
    np.testing.assert_allclose(floats(second.positions)[:2], (math.pi / 20, -math.pi / 40))
    np.testing.assert_allclose(floats(second.velocities)[0], math.pi / 20 / 0.02)
    assert second.stamp_nanos == 5 + PERIOD


def test_a_counter_that_was_reset_is_no_speed() -> None:
    _, (base,) = of("indoor_paper")
    joints(base, (10**7, 10**7), 5)
    assert not any(floats(joints(base, (0, 0), 5 + PERIOD).velocities))


def test_all_joints_of_the_description_are_published() -> None:
    for name in SCENARIOS:
        for base in of(name)[1]:
            wheels = {wheel.name for wheel in base._vehicle.model.wheels}
            joints = re.findall(r'<joint name="(\w+)" type="continuous">', base.description)
            turning = len(wheels & {*joints})
            if "encoders" in base.keys:
                counted = len(base._vehicle.model.counted)
                ticks = WheelEncoders(5, "", ("a",) * counted, (0,) * counted)
                topic, message, _ = next(base.receive(base.keys["encoders"], ticks))
                assert isinstance(message, JointState)
                assert topic == f"{base._vehicle.namespace}/joint_states"
                assert len(message.names) == len(floats(message.positions)) == turning
                for joint in message.names:
                    assert f'<joint name="{joint}" type="continuous">' in base.description
            else:
                assert not turning


def test_wheels_carry_the_base_through_odom() -> None:
    _, (base,) = of("indoor_paper")
    late = odometry(7, 2.0, 0.5, clock_error=3)
    (moved,) = told(base, [("odometry", late)])
    assert (moved.stamp_nanos, moved.parent, moved.child) == (7, "odom", "base_link")
    assert (moved.translation_m, moved.rotation) == (late.position_m, late.orientation)
    assert list(base.receive("groundlink/r/robot/ground_truth", late)) == []


def test_no_transform_where_a_filter_publishes_it() -> None:
    _, (base,) = of("indoor_paper", odom=False)
    assert "odometry" not in base.keys


def test_an_ideal_localisation_goes_on_where_time_jumps_back() -> None:
    """As in a replay that loops, whose episode stays the same."""
    _, (base,) = of("indoor_paper", map="truth")
    found = []
    for _ in range(2):
        for i in range(5):
            rows = [
                ("truth", odometry(i * PERIOD, 3.0, 0.2, frame="world")),
                ("odometry", odometry(i * PERIOD, 0.5, 0.1)),
            ]
            found += [row.stamp_nanos for row in told(base, rows) if row.parent == "map"]
    assert found == [i * PERIOD for i in range(5)] * 2


def test_an_ideal_localisation_waits_for_odometry_that_is_far_behind() -> None:
    """In a fast run physics may be a second ahead, and its truth as fast as its ticks."""
    _, (base,) = of("indoor_paper", map="truth")
    told(base, [("truth", odometry(i * PERIOD, 3.0, 0.2, frame="world")) for i in range(400)])
    reckoned = told(base, [("odometry", odometry(i * PERIOD, 0.5, 0.1)) for i in range(400)])
    assert len([row for row in reckoned if row.parent == "map"]) == 400


@pytest.mark.parametrize("order", ["truth first", "odometry first"])
def test_an_ideal_localisation_makes_up_for_the_wheels(order: str) -> None:
    _, (base,) = of("indoor_paper", map="truth")
    # Odometry is of an instant between two truths, and on a clock that is 1000 ns fast.
    truths = [
        ("truth", odometry(0, 3.0, 0.2, frame="world")),
        ("truth", odometry(PERIOD, 4.0, 0.4, frame="world")),
    ]
    reckoned = [("odometry", odometry(PERIOD // 2 + 1000, 0.5, 0.1, clock_error=1000))]
    both = told(base, truths + reckoned if order == "truth first" else reckoned + truths)
    (moved,) = [row for row in both if row.parent == "map"]
    assert (moved.child, moved.stamp_nanos) == ("odom", PERIOD // 2 + 1000)
    map_from_base = transform(moved.translation_m, moved.rotation) @ transform(
        (0.5, 1.0, 0.0), quaternion_from_rpy(0, 0, 0.1)
    )
    expected = transform((3.5, 1.0, 0.0), quaternion_from_rpy(0, 0, 0.3))
    np.testing.assert_allclose(map_from_base, expected, atol=1e-6)


def test_an_ideal_localisation_turns_odometry_about_the_axes_of_the_map() -> None:
    """A base that leans is where the truth has it, though its odometry is level."""
    _, (base,) = of("indoor_paper", map="truth")
    turned = quaternion_from_rpy(0.3, -0.2, 1.0)
    truth = replace(odometry(PERIOD, 3.0, 0.0, frame="world"), orientation=turned)
    rows = told(base, [("odometry", odometry(PERIOD, 0.5, 0.4)), ("truth", truth)])
    (moved,) = [row for row in rows if row.parent == "map"]
    map_from_base = transform(moved.translation_m, moved.rotation) @ transform(
        (0.5, 1.0, 0.0), quaternion_from_rpy(0, 0, 0.4)
    )
    np.testing.assert_allclose(map_from_base, transform((3.0, 1.0, 0.0), turned), atol=1e-6)


def test_another_episode_knows_nothing_of_the_one_before() -> None:
    _, (base,) = of("indoor_paper", map="truth")
    told(base, [("truth", odometry(9 * PERIOD, 3.0, 0.2))])
    base.restart()
    rows = told(base, [("odometry", odometry(PERIOD, 0.0, 0.0))])
    assert [row.parent for row in rows] == ["odom"]


def test_vehicle_without_odometry_is_placed_in_the_map() -> None:
    _, (base,) = of("outdoor_paper", map="truth")
    (moved,) = told(base, [("truth", odometry(5, 3.0, 0.2, frame="world"))])
    assert (moved.parent, moved.child, moved.translation_m[0]) == ("map", "base_link", 3.0)


@pytest.mark.parametrize("where", ["none", "identity", "truth"])
@pytest.mark.parametrize("name", SCENARIOS)
def test_the_tree_is_one(name: str, where: str) -> None:
    """No frame has two parents; with the truth all have one root, else each vehicle one."""
    scenario, bases = of(name, map=where)
    still = still_transforms(scenario, bases, 1)
    rows = list(still.transforms) if still else []
    for base in bases:
        prefix = base._vehicle.frame_prefix
        for role in base.keys.keys() - {"encoders"}:
            frame = "world" if role == "truth" else f"{prefix}odom"
            message = replace(odometry(5, 1.0, 0.0, frame=frame), child_frame=f"{prefix}base_link")
            rows += told(base, [(role, message)])
    parents: dict[str, str] = {}
    for row in rows:
        assert row.child not in parents, f"{row.child} has two parents"
        parents[row.child] = row.parent
    roots = {*parents.values()} - parents.keys()
    # A map above the odometry of a stack, which is not there: two trees until it is.
    apart = sum("odometry" not in base.keys for base in bases) if where == "identity" else 0
    assert len(roots) == (1 if where == "truth" else len(bases) + apart)
    if where == "truth":
        assert roots == {"world"}
        assert parents["map"] == "world"


def test_maps_of_several_vehicles_are_apart_where_each_begins_at_its_own() -> None:
    scenario, bases = of("two_rovers", map="identity")
    still = still_transforms(scenario, bases, 1)
    assert still is not None
    children = {row.child: row.parent for row in still.transforms}
    assert children["first/odom"] == "first/map"
    assert children["second/odom"] == "second/map"


def test_topics_are_unique() -> None:
    for name in SCENARIOS:
        scenario, bases = of(name, map="truth")
        others = {stream.topic for stream in outgoing(scenario, RUN)}
        for base in bases:
            assert others.isdisjoint(each.topic for each in base.topics)


def test_the_way_from_map_to_odom_needs_odom() -> None:
    with pytest.raises(ValueError, match="needs `odom: true`"):
        TfTree(odom=False, map="truth")
