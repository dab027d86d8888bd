# SPDX-License-Identifier: Apache-2.0
"""Commands and states of joints between ROS and the bus, and their block in the description."""

import re
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from msgspec.structs import replace

from groundlink.bus.topics import JOINT_COMMAND, joint_stream
from groundlink.loader import load
from groundlink.loader.document import read
from groundlink.loader.scenario_files import SHIPPED
from groundlink.loader.validation_errors import convert
from groundlink.messages.base import BadBusMessage, WheelEncoders, floats, packed
from groundlink.messages.navigation import JointState
from groundlink.ros.base import Base
from groundlink.ros.cdr import reader
from groundlink.ros.streams import RosStream, incoming
from groundlink.ros.types import STORE, TYPES, header
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import FromRos, JointGroup
from groundlink.scenario.running_gear import SkidSteer
from groundlink.scenario.vehicle import VehicleModel

RUN = "r"
NAN = float("nan")
WHEELS = ("front_left_wheel", "front_right_wheel")
STEERING = ("front_left_wheel_steering", "front_right_wheel_steering")
COMMANDS = "/velocity_controller/commands"
PERIOD = 20_000_000


@cache
def model(name: str) -> VehicleModel:
    return convert(read(SHIPPED / "vehicles" / f"{name}.yaml"), VehicleModel)


@cache
def shipped_run() -> Scenario:
    return load("indoor_paper")


def scenario(from_ros: FromRos, name: str = "car", *, encoders: bool = False) -> Scenario:
    """Return a run of one vehicle whose joints ROS commands."""
    loaded = shipped_run()
    (vehicle,) = loaded.vehicles
    sensors = tuple(s for s in vehicle.sensors if encoders and s.kind == "encoders")
    changed = replace(vehicle, model=model(name), sensors=sensors, from_ros=from_ros)
    return replace(loaded, vehicles=(changed,))


def taken(stream: RosStream, body: Any, ros_type: str) -> JointState:
    cdr = STORE.serialize_cdr(body, ros_type)
    found = reader(stream.message, ros_type, stream.joints)(cdr, 7)
    assert isinstance(found, JointState)
    assert (found.stamp_nanos, found.frame) == (7, "")
    return found


def joint_state(**of: Any) -> JointState:
    """Return what the bus has of a sensor_msgs/JointState for the car."""
    ros_type = "sensor_msgs/msg/JointState"
    stream = incoming(scenario(FromRos(joints="/joint_commands")), RUN)[-1]
    arrays = (np.array(of.get(field, ()), float) for field in ("position", "velocity", "effort"))
    return taken(stream, TYPES[ros_type](header(1, "x"), [*of["name"]], *arrays), ros_type)


def group(values: tuple[float, ...], interface: Any = "velocity") -> JointState:
    """Return what the bus has of a std_msgs/Float64MultiArray for the car's wheels."""
    names = STEERING if interface == "position" else WHEELS
    group = JointGroup(interface=interface, joints=names)
    stream = incoming(scenario(FromRos(joint_groups={COMMANDS: group})), RUN)[-1]
    assert (stream.topic, stream.is_command) == (COMMANDS, True)
    assert stream.key == f"groundlink/r/robot/command/joints{COMMANDS}"
    assert joint_stream(stream.key) == f"joints{COMMANDS}"
    layout = TYPES["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    body = TYPES[stream.ros_type](layout=layout, data=np.array(values, float))
    return taken(stream, body, stream.ros_type)


def values(command: JointState) -> list[list[float]]:
    return [
        floats(each).tolist() for each in (command.positions, command.velocities, command.efforts)
    ]


def test_values_without_gaps_belong_to_the_joints_that_they_command() -> None:
    """As topic_based_ros2_control publishes joints of several kinds."""
    found = joint_state(
        name=(*WHEELS, "unknown", *STEERING), velocity=(1.0, 2.0), position=(0.1, 0.2)
    )
    assert found.names == (*WHEELS, "unknown", *STEERING)
    positions, velocities, efforts = values(found)
    np.testing.assert_array_equal(positions, [NAN, NAN, NAN, 0.1, 0.2])
    np.testing.assert_array_equal(velocities, [1.0, 2.0, NAN, NAN, NAN])
    assert efforts == []


def test_values_for_every_name_are_taken_as_they_are() -> None:
    found = joint_state(name=WHEELS, velocity=(NAN, 2.0), effort=(3.0, NAN))
    assert found.names == WHEELS
    np.testing.assert_array_equal(values(found)[1], [NAN, 2.0])
    np.testing.assert_array_equal(values(found)[2], [3.0, NAN])


@pytest.mark.parametrize(
    "of",
    [
        {"name": (*WHEELS, *STEERING), "velocity": (1.0, 2.0, 3.0)},
        {"name": WHEELS},
        {"name": WHEELS, "velocity": (NAN, NAN)},
        {"name": WHEELS, "effort": (1.0, float("-inf"))},
        {"name": ("x" * 300,), "velocity": (1.0,)},
    ],
    ids=["count", "empty", "NaN alone", "infinite", "long name"],
)
def test_joint_states_that_command_nothing_are_refused(of: dict[str, Any]) -> None:
    with pytest.raises(BadBusMessage):
        joint_state(**of)


@pytest.mark.parametrize(("interface", "place"), [("position", 0), ("velocity", 1), ("effort", 2)])
def test_a_multi_array_commands_its_group_in_order(interface: str, place: int) -> None:
    found = group((0.25, NAN), interface)
    assert found.names == (STEERING if interface == "position" else WHEELS)
    got = values(found)
    np.testing.assert_array_equal(got.pop(place), [0.25, NAN])
    assert got == [[], []]


@pytest.mark.parametrize("given", [(), (1.0,), (1.0, 2.0, 3.0), (float("inf"), 1.0)])
def test_a_multi_array_of_another_size_is_refused(given: tuple[float, ...]) -> None:
    with pytest.raises(BadBusMessage):
        group(given)


@pytest.mark.parametrize(
    ("interface", "joint", "why"),
    [
        ("position", WHEELS[0], "no joint `front_left_wheel` takes commands of `position`"),
        ("velocity", "rear_left_wheel", "expected one of front_left_wheel, front_right_wheel"),
        ("effort", "hatch", "expected one of front_left_wheel, front_right_wheel"),
    ],
)
def test_a_group_has_joints_of_its_interface(interface: Any, joint: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        scenario(FromRos(joint_groups={"/x": JointGroup(interface=interface, joints=(joint,))}))


def block(name: str, from_ros: FromRos) -> ElementTree.Element:
    made = scenario(from_ros, name)
    return ElementTree.fromstring(Base(made, made.vehicles[0], RUN).description)


@pytest.mark.parametrize(
    ("name", "interfaces"),
    [
        ("car", dict.fromkeys(WHEELS, "velocity") | dict.fromkeys(STEERING, "position")),
        (
            "tank",
            {
                "left_track": "velocity",
                "right_track": "velocity",
                "turret": "position",
                "gun": "position",
            },
        ),
        (
            "rover",
            dict.fromkeys(
                ("front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel"),
                "velocity",
            ),
        ),
    ],
)
def test_the_description_has_a_block_for_ros2_control(
    name: str, interfaces: dict[str, str]
) -> None:
    robot = block(name, FromRos(joints="/joint_commands"))
    (system,) = robot.findall("ros2_control")
    assert system.attrib == {"name": f"{robot.attrib['name']}_system", "type": "system"}
    assert system.findtext("hardware/plugin") == "topic_based_ros2_control/TopicBasedSystem"
    parameters = {each.attrib["name"]: each.text for each in system.iterfind("hardware/param")}
    assert parameters == {
        "joint_commands_topic": "/joint_commands",
        "joint_states_topic": "/joint_states",
        "trigger_joint_command_threshold": "-1",
    }
    assert {
        joint.attrib["name"]: [each.attrib["name"] for each in joint.iter("command_interface")]
        for joint in system.iterfind("joint")
    } == {joint: [interface] for joint, interface in interfaces.items()}
    movable = {j.attrib["name"] for j in robot.iterfind("joint") if j.attrib["type"] != "fixed"}
    assert movable >= set(interfaces)
    children = [each.attrib["link"] for each in robot.iterfind("joint/child")]
    links = [each.attrib["name"] for each in robot.iterfind("link")]
    assert sorted([*children, "base_link"]) == sorted(links)
    assert not block(name, FromRos()).findall("ros2_control")


def test_a_steered_wheel_turns_below_its_steering_joint() -> None:
    robot = block("car", FromRos(joints="/joint_commands"))
    steered = robot.find(f"joint[@name='{STEERING[0]}']")
    rolling = robot.find(f"joint[@name='{WHEELS[0]}']")
    assert steered is not None
    assert rolling is not None
    ends = [joint.find("parent") for joint in (steered, rolling)]
    assert [end.attrib["link"] for end in ends if end is not None] == [
        "base_link",
        f"{STEERING[0]}_link",
    ]
    origin, axis = steered.find("origin"), steered.find("axis")
    assert origin is not None
    assert axis is not None
    assert (origin.attrib["xyz"], axis.attrib["xyz"]) == ("1.31 0.76 0", "0 0 1")


def truth(stamp: int, names: tuple[str, ...], position: float, effort: float) -> JointState:
    at, speed, torque = (packed(np.full(len(names), v)) for v in (position, 5.0, effort))
    return JointState(stamp, "base_link", names, at, speed, torque)


@pytest.mark.parametrize("late", [False, True])
def test_wheels_with_encoders_have_their_errors_in_the_states_of_all_joints(late: bool) -> None:
    """An encoder's reading and the truth of its instant come in any order."""
    made = scenario(FromRos(joints="/joint_commands"), "decontamination_robot", encoders=True)
    (vehicle,) = made.vehicles
    base = Base(made, vehicle, RUN)
    wheels = tuple(wheel.name for wheel in vehicle.model.wheels)
    counted = [shaft.name for shaft in vehicle.model.counted]
    zero = WheelEncoders(0, "base_link", ("a", "b"), (0, 0))
    reading = WheelEncoders(PERIOD * 3 // 2, "base_link", ("a", "b"), (1000, -1000))
    rows: list[tuple[str, Any]] = [("encoders", zero)]
    rows += [("wheels", truth(i * PERIOD, wheels, float(i), 4.0)) for i in range(3)]
    rows.insert(4 if late else 2, ("encoders", reading))
    found = [each for role, row in rows for each in base.receive(base.keys[role], row)]
    assert [each.nanos for each in found] == [0, PERIOD * 3 // 2]
    states = found[-1].message
    assert isinstance(states, JointState)
    assert [*states.names] == counted
    positions, velocities, efforts = values(states)
    assert positions[0] == -positions[1] != 0.0
    assert velocities[0] == -velocities[1] != 0.0
    assert efforts == [4.0, 4.0]


def test_without_encoders_states_are_those_of_ideal_sensors() -> None:
    made = scenario(FromRos(joints="/joint_commands"))
    base = Base(made, made.vehicles[0], RUN)
    wheels = tuple(wheel.name for wheel in made.vehicles[0].model.wheels)
    assert not list(base.receive(base.keys["wheels"], truth(5, wheels, 1.0, 4.0)))
    steering = replace(truth(5, STEERING, 0.2, 0.0), efforts=memoryview(b""))
    assert not list(base.receive(base.keys["joints"], replace(steering, stamp_nanos=4)))
    (found,) = base.receive(base.keys["joints"], steering)
    states = found.message
    assert isinstance(states, JointState)
    assert states.names == (*WHEELS, *STEERING)
    np.testing.assert_array_equal(
        values(states), [[1.0, 1.0, 0.2, 0.2], [5.0] * 4, [4.0, 4.0, NAN, NAN]]
    )
    (topic,) = (each for each in base.topics if each.topic == "/joint_states")
    assert topic.declared_hz == made.vehicles[0].ground_truth.rate_hz


def test_messages_of_two_instants_may_be_mixed() -> None:
    made = scenario(FromRos(joints="/joint_commands"))
    base = Base(made, made.vehicles[0], RUN)
    wheels = tuple(wheel.name for wheel in made.vehicles[0].model.wheels)
    rows: list[tuple[str, Any]] = [("wheels", truth(i, wheels, 1.0, 4.0)) for i in range(3)]
    rows += [("joints", truth(i, STEERING, 0.2, 0.0)) for i in (0, 2)]  # one is lost
    found = [each for role, row in rows for each in base.receive(base.keys[role], row)]
    assert [each.nanos for each in found] == [0, 2]


def test_a_joint_state_has_the_key_of_all_joints() -> None:
    stream = incoming(scenario(FromRos(joints="/joint_commands")), RUN)[-1]
    assert stream.key == JOINT_COMMAND.key_in(RUN, vehicle="robot")
    assert joint_stream(stream.key) == "joints"


PAGE = (Path(__file__).parents[3] / "docs" / "how-to" / "ros2-control.md").read_text()


def test_the_page_shows_the_block_of_the_rover() -> None:
    made = scenario(FromRos(joints="/joint_commands"), "rover")
    (shown,) = re.findall(r"```xml\n(.*?)```", PAGE, re.DOTALL)
    assert shown in Base(made, made.vehicles[0], RUN).description


def test_the_page_has_the_controllers_figures_of_the_models() -> None:
    (text,) = re.findall(r"```text\n(controller_manager.*?)```", PAGE, re.DOTALL)
    parameters = yaml.safe_load(text)["diff_drive_controller"]["ros__parameters"]
    rows = {line.split("|")[1].strip(" `"): line for line in PAGE.splitlines() if "| `" in line}
    for name in ("rover", "decontamination_robot", "car"):
        (left, *_) = (w for w in model(name).wheels if w.center_m[1] > 0)
        track, radius = 2 * left.center_m[1], left.radius_m
        assert f"| {track:g}" in rows[name]
        assert rows[name].endswith(f"| {radius:g} |")
    of_rover = (2 * model("rover").wheels[0].center_m[1], model("rover").wheels[0].radius_m)
    assert (parameters["wheel_separation"], parameters["wheel_radius"]) == of_rover
    drive = model("rover").drive
    assert isinstance(drive, SkidSteer)
    assert parameters["wheel_separation_multiplier"] == drive.track_multiplier
    names = {*parameters["left_wheel_names"], *parameters["right_wheel_names"]}
    assert names == {joint.name for joint in model("rover").joint_interfaces()}
