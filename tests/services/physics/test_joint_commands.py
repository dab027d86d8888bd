# SPDX-License-Identifier: Apache-2.0
"""Commands of joints from ROS to the states: read, taken in, journaled, done again."""

import numpy as np
import pytest

from groundlink.bus.topics import JOINT_COMMAND, JOINTS, TRUE_WHEELS
from groundlink.episode.journal import JointsCommanded
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import BadBusMessage, State, decode, floats, packed
from groundlink.messages.navigation import JointState
from groundlink.ros.base import Bases
from groundlink.ros.cdr import READERS, to_cdr
from groundlink.ros.streams import incoming
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import Mount
from services.physics.run.episode import Episode
from services.physics.run.publishers import silent_publishers
from services.physics.trials.track import drive, put
from services.sensors.runtime.world_replica import WorldReplica

from .free_bodies import FreeBodies
from .grounds import shipped

NOTHING = memoryview(b"")
TRACKS = ("left_track", "right_track")


@pytest.fixture(scope="module")
def outdoors() -> Scenario:
    return load(SHIPPED / "outdoor_paper.yaml")


def command(stamp_nanos: int = 0, **positions: float) -> JointState:
    at = packed(np.array([*positions.values()]))
    return JointState(stamp_nanos, "", tuple(positions), at, NOTHING, NOTHING)


def test_a_joint_state_of_ros_is_a_command_of_the_run(outdoors: Scenario) -> None:
    (stream,) = (s for s in incoming(outdoors, "run") if s.message is JointState)
    assert stream.topic == "/joint_commands"
    assert stream.key == JOINT_COMMAND.key_in("run", vehicle="tank")
    found = READERS["sensor_msgs/msg/JointState"](to_cdr(command(7, turret=0.5, gun=0.1)), 11)
    assert found == command(11, turret=0.5, gun=0.1)


@pytest.mark.parametrize(
    "body",
    [
        to_cdr(JointState(0, "", ("gun",), NOTHING, NOTHING, NOTHING)),
        to_cdr(command(gun=float("nan"))),
        to_cdr(command(gun=float("inf"))),
        to_cdr(command(gun=0.1))[:-4],
    ],
    ids=["no values", "nothing but NaN", "not finite", "cut off"],
)
def test_joint_states_that_are_no_commands_are_refused(body: bytes) -> None:
    with pytest.raises(BadBusMessage):
        READERS["sensor_msgs/msg/JointState"](body, 0)


def test_an_episode_that_is_done_again_moves_its_joints_again(outdoors: Scenario) -> None:
    def episode() -> Episode:
        made = Episode(outdoors, "run", silent_publishers(), required=(), wall_nanos=10**18)
        made.begin(0, 0.0)
        return made

    first = episode()
    try:
        assert first.command("tank", command(first.epoch_nanos + 5_000_000, turret=0.4))
        with pytest.raises(ValueError, match="no joint `door`"):
            first.command("tank", command(first.epoch_nanos, door=0.4))
        ahead = JointState(first.epoch_nanos, "", TRACKS, NOTHING, packed(np.ones(2)), NOTHING)
        assert first.command("tank", ahead, stream="joints/velocity_controller/commands")
        for _ in range(40):
            first.step()
        journal = first.journal()
        speed = floats(decode(first._history[-1], State).vehicles["tank"].base_velocity)
        assert np.hypot(*speed[:2]) > 0.05
    finally:
        first.end()
    entry, of_tracks = journal.read()
    assert isinstance(entry, JointsCommanded)
    assert entry.command.stamp_nanos == 5_000_000
    assert isinstance(of_tracks, JointsCommanded)
    assert of_tracks.command.stamp_nanos == 0
    second = episode()
    try:
        second.replay(entry)
        second.replay(of_tracks)
        for _ in range(40):
            second.step()
        assert second.journal().digest == journal.digest
    finally:
        second.end()


def test_joint_states_tell_where_all_joints_are(outdoors: Scenario) -> None:
    """A reader that keeps the newest message alone, as of ros2_control, misses none."""
    bases, model = Bases(outdoors, "run"), outdoors.vehicles[0].model
    wheels = tuple(wheel.name for wheel in model.wheels)
    ratios = {
        s.name: [s.radius_m / model.wheels[i].radius_m for i in s.wheels] for s in model.counted
    }
    of_wheels = [packed(np.full(len(wheels), value)) for value in (2.0, 3.0, 10.0)]
    truth = JointState(10**18, "tank/base_link", wheels, *of_wheels)
    assert not list(bases.receive(TRUE_WHEELS.key_in("run", vehicle="tank"), truth))
    said = command(10**18, turret=0.25, gun=0.1)
    (told,) = bases.receive(JOINTS.key_in("run", vehicle="tank"), said)
    assert (told.topic, told.nanos) == ("/joint_states", 10**18)
    states = told.message
    assert isinstance(states, JointState)
    assert states.names == (*TRACKS, "turret", "gun")
    for name, position, velocity, effort in zip(
        states.names,
        floats(states.positions),
        floats(states.velocities),
        floats(states.efforts),
        strict=True,
    ):
        if name in TRACKS:
            first = ratios[name][0]
            assert (position, velocity) == pytest.approx((2 / first, 3 / first))
            assert effort == pytest.approx(10 * sum(ratios[name]))
        else:
            assert position == {"turret": 0.25, "gun": 0.1}[name]
            assert np.isnan(effort)
    (joint_topic,) = (p for p in bases.topics if p.topic == "/joint_states")
    assert joint_topic.declared_hz == outdoors.vehicles[0].ground_truth.rate_hz


def test_rays_and_pictures_see_the_joint_where_it_is(outdoors: Scenario) -> None:
    with put(shipped("tank"), new_backend=FreeBodies) as simulation:
        simulation.command("it", command(turret=0.2))
        drive(simulation, 1.0)
        vehicle = simulation.vehicle_states()["it"]
    tank = outdoors.vehicles[0]
    around = WorldReplica(outdoors, tank, Mount((0.0, 0.0, 0.0)))
    around.take(
        State(
            "t",
            0,
            0,
            0,
            0,
            "",
            {"tank": vehicle},
            packed(np.zeros((len(outdoors.world.actors), 7))),
        )
    )
    names = tank.model.link_names()
    joint_topic = names.index("turret_link")
    assert {solid.name for solid in around.links[joint_topic]} >= {"turret_wall", "antenna"}
    assert around.motion(0, 0)[0, joint_topic, 5] == pytest.approx(np.sin(0.1), abs=1e-3)
    assert floats(vehicle.servo_positions).tolist() == pytest.approx([0.2, 0.0])
