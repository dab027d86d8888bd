# SPDX-License-Identifier: Apache-2.0
"""Sensors on the links of joints: they turn with a turret and rise with a gun."""

from collections.abc import Iterator
from math import radians

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.frames import transform
from groundlink.loader import load
from groundlink.loader.scenario_files import SHIPPED
from groundlink.messages.base import State, packed
from groundlink.messages.navigation import JointState
from groundlink.ros.base import Bases
from groundlink.ros.streams import mounts
from groundlink.scenario import Scenario
from groundlink.scenario.every_sensor import Mount
from services.physics.trials.track import put
from services.sensors.gnss.model import GnssModel
from services.sensors.gnss.spec import Gnss
from services.sensors.imu.model import ImuModel
from services.sensors.imu.spec import InertialUnit
from services.sensors.rays.probe import RayProbe

from .free_bodies import FreeBodies
from .grounds import shipped

ON_TURRET = Mount((1.0, 0.5, 0.6), (0.0, 0.0, 10.0), "turret")
ON_GUN = Mount((2.0, 0.0, 0.2), (0.0, 0.0, 0.0), "gun")
SPEED_RADPS = 0.2
NOTHING = memoryview(b"")


@pytest.fixture(scope="module")
def outdoors() -> Scenario:
    """The tank with a gyroscope, a receiver and a range finder on turret and gun."""
    found = load(SHIPPED / "outdoor_paper.yaml")
    tank = replace(
        found.vehicles[0],
        sensors=(
            InertialUnit(name="imu", topic="/imu", frame="imu", mount=ON_TURRET, rate_hz=400.0),
            Gnss(name="gnss", topic="/gnss", frame="gnss", mount=ON_TURRET, rate_hz=20.0),
        ),
        route=None,
    )
    return replace(found, vehicles=(tank,), world=replace(found.world, actors=()))


def turning(scenario: Scenario, seconds: float) -> Iterator[State]:
    """Yield the states of a tank in the air that turns its turret and raises its gun."""
    with put(shipped("tank"), new_backend=FreeBodies) as simulation:
        at, speeds = packed(np.array([1.0, 0.2])), packed(np.array([SPEED_RADPS, 0.05]))
        simulation.command("it", JointState(0, "", ("turret", "gun"), at, speeds, NOTHING))
        for tick in range(1, round(seconds * TICK_RATE_HZ) + 1):
            simulation.step()
            state = simulation.vehicle_states()["it"]
            nanos = simulation.sim_nanos
            yield State("t", 0, 0, tick, nanos, "", {"tank": state})


def test_a_probe_on_the_gun_is_where_the_gun_is(outdoors: Scenario) -> None:
    tank = outdoors.vehicles[0]
    probe = RayProbe(outdoors, tank, ON_GUN)
    for state in turning(outdoors, 0.2):
        probe.take(state)
    link = state.vehicles["tank"].poses()[tank.model.link_names().index("gun_link")]
    expected = transform(link[:3], link[3:]) @ transform(ON_GUN.xyz_m, ON_GUN.quaternion())
    there = probe.place(state.sim_nanos)
    assert there.origin_in_world == pytest.approx(expected[:3, 3])
    assert there.world_from_sensor == pytest.approx(expected[:3, :3])
    # The gun has risen by 0.05 rad/s.
    assert there.world_from_sensor[2, 0] == pytest.approx(0.01, rel=1e-3)


def test_an_imu_on_the_turret_feels_it_turn(outdoors: Scenario) -> None:
    tank = outdoors.vehicles[0]
    unit = tank.sensors[0]
    assert isinstance(unit, InertialUnit)
    model = ImuModel(outdoors, tank, unit)
    readings = [r for state in turning(outdoors, 0.3) for r in model.readings(state)]
    assert readings[-1].angular_velocity_radps[2] == pytest.approx(SPEED_RADPS, abs=1e-3)
    # Inward: the turret's radius of 1.12 m, seen from a mount that is turned by 10 degrees.
    ax, ay, _ = np.mean([r.linear_acceleration_mps2 for r in readings[-80:]], axis=0)
    inward = np.hypot(1.0, 0.5) * SPEED_RADPS**2
    angle = np.arctan2(0.5, 1.0) - radians(10.0)
    assert (ax, ay) == pytest.approx((-inward * np.cos(angle), -inward * np.sin(angle)), abs=2e-3)


def test_a_receiver_on_the_turret_moves_with_it(outdoors: Scenario) -> None:
    tank = outdoors.vehicles[0]
    unit = tank.sensors[1]
    assert isinstance(unit, Gnss)
    model = GnssModel(outdoors, tank, replace(unit, sky_view=False, velocity_stddev_mps=0.0))
    fixes = [f for state in turning(outdoors, 0.5) for f in model.readings(state)]
    epoch = model.details(fixes[-1]).epoch
    speed = np.hypot(epoch.east_mps, epoch.north_mps)
    assert speed == pytest.approx(np.hypot(1.0, 0.5) * SPEED_RADPS, rel=0.02)


def test_ros_gets_the_frame_below_that_of_the_joint(outdoors: Scenario) -> None:
    tank = outdoors.vehicles[0]
    assert {m.child: m.parent for m in mounts(tank, 0)} == {
        "imu": "turret_link",
        "gnss": "turret_link",
    }
    (description,) = (m.message for m in Bases(outdoors, "run").still(0) if "descr" in m.topic)
    joint = description.text.split('name="imu_joint"')[1].split("</joint>")[0]
    assert 'link="turret_link"' in joint


def test_joints_that_carry_nothing_are_refused() -> None:
    tank = shipped("tank")
    with pytest.raises(ValueError, match=r"`mounts.eye.joint`: no joint `mast` .* turret, gun"):
        replace(tank, mounts={"eye": Mount(joint="mast")})
    with pytest.raises(ValueError, match=r"expected one of none: omit it for the base"):
        replace(shipped("rover"), mounts={"eye": Mount(joint="turret")})
