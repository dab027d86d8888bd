# SPDX-License-Identifier: Apache-2.0
"""Joints other than wheels: they go where they are commanded, within limits and speed."""

from math import pi

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from groundlink.messages.base import VehicleState, encode, floats
from groundlink.messages.navigation import JointState
from groundlink.scenario.joints import Joint, base_from_links, check
from services.physics.trials.track import NAME, drive, put
from services.physics.vehicle.servos import Servos
from tests.services.physics.grounds import shipped

TICK_NANOS = 2_500_000
TURRET = Joint(name="turret", at_m=(1.0, 0.0, 2.0), max_speed=0.5)
GUN = Joint(
    name="gun",
    parent="turret",
    at_m=(0.5, 0.0, 0.1),
    axis=(0.0, -2.0, 0.0),
    lower=-0.1,
    upper=0.3,
    max_speed=0.1,
)
RAM = Joint(
    name="ram", kind="prismatic", parent="gun", at_m=(0.0, 0.0, 0.0), axis=(1, 0, 0), max_speed=1.0
)


def asked(
    stamp_nanos: int = 0, velocities: tuple[float, ...] = (), **positions: float
) -> JointState:
    return JointState(
        stamp_nanos,
        "",
        tuple(positions),
        memoryview(np.array([*positions.values()]).tobytes()),
        memoryview(np.array(velocities).tobytes()),
        memoryview(b""),
    )


def stepped(servos: Servos, ticks: int, first: int = 0) -> list[float]:
    for tick in range(first, first + ticks):
        servos.step(tick * TICK_NANOS)
    return servos.positions


def test_a_joint_goes_to_its_target_at_its_speed_and_stays() -> None:
    servos = Servos((TURRET,))
    assert servos.command(asked(turret=0.25))
    assert stepped(servos, 100) == pytest.approx([0.125])
    assert servos.speeds == pytest.approx([0.5])
    assert stepped(servos, 300, 100) == pytest.approx([0.25])
    assert servos.speeds == [0.0]


def test_servo_keeps_commanded_and_maximum_speed() -> None:
    for said, speed in ((0.2, 0.2), (-0.2, 0.2), (0.0, 0.5), (9.0, 0.5)):
        servos = Servos((TURRET,))
        servos.command(asked(turret=3.0, velocities=(said,)))
        assert stepped(servos, 40) == pytest.approx([0.1 * speed])


def test_targets_are_within_limits() -> None:
    servos = Servos((TURRET, GUN))
    servos.command(asked(gun=1.0, turret=-20.0))
    assert stepped(servos, 400 * 60) == pytest.approx([-20.0, 0.3])
    servos.command(asked(gun=-1.0))
    assert stepped(servos, 400 * 60, 400 * 60) == pytest.approx([-20.0, -0.1])


def test_a_command_acts_at_its_stamp_and_others_go_on() -> None:
    servos = Servos((TURRET, GUN), epoch_nanos=10**18)
    servos.command(asked(10**18 + 100 * TICK_NANOS, gun=0.3))
    servos.command(asked(10**18, turret=0.1))
    assert stepped(servos, 100) == pytest.approx([0.1, 0.0])
    assert stepped(servos, 40, 100) == pytest.approx([0.1, 0.01])


@pytest.mark.parametrize(
    "command",
    [
        asked(cannon=0.1),
        asked(turret=float("nan")),
        asked(turret=0.1, velocities=(float("inf"),)),
        JointState(0, "", ("turret",), memoryview(b""), memoryview(b""), memoryview(b"")),
    ],
)
def test_what_cannot_be_obeyed_is_refused(command: JointState) -> None:
    with pytest.raises(ValueError, match=r"no joint `cannon`|finite|positions"):
        Servos((TURRET, GUN)).command(command)


def test_links_are_where_rotations_say() -> None:
    turn, lift, slide = 0.7, 0.2, 0.4
    turret, gun, ram = base_from_links((TURRET, GUN, RAM), (turn, lift, slide))
    world_turret = Rotation.from_euler("z", turn)
    world_gun = world_turret * Rotation.from_rotvec([0, -lift, 0])
    at_gun = np.array([1.0, 0.0, 2.0]) + world_turret.apply([0.5, 0.0, 0.1])
    np.testing.assert_allclose(turret[0], (1.0, 0.0, 2.0))
    np.testing.assert_allclose(gun[0], at_gun)
    np.testing.assert_allclose(ram[0], at_gun + world_gun.apply([slide, 0, 0]))
    for (_, found), expected in ((turret, world_turret), (gun, world_gun), (ram, world_gun)):
        assert (Rotation.from_quat(found).inv() * expected).magnitude() < 1e-12


@pytest.mark.parametrize(
    ("joints", "words"), [((GUN,), "parent `turret`"), ((TURRET, TURRET), "named `turret`")]
)
def test_joints_that_do_not_go_together_are_refused(joints: tuple[Joint, ...], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        check(joints, ["wheel"])


def test_limits_without_zero_are_refused() -> None:
    with pytest.raises(ValueError, match="excludes 0"):
        Joint(name="it", at_m=(0, 0, 0), lower=0.1, max_speed=1.0)


def test_the_tanks_turret_and_gun_turn_with_the_tank() -> None:
    model = shipped("tank")
    with put(model) as simulation:
        simulation.command(NAME, asked(turret=pi / 2, gun=0.3))
        drive(simulation, 7.0)
        state: VehicleState = simulation.vehicle_states()[NAME]
    assert floats(state.servo_positions).tolist() == pytest.approx([pi / 2, 0.3])
    names = model.link_names()
    poses = state.poses()
    assert len(names) == len(poses)
    base, turret, gun = (poses[names.index(n)] for n in ("base_link", "turret_link", "gun_link"))
    np.testing.assert_allclose(turret[:3] - base[:3], (0.22, 0.0, 0.965), atol=0.01)
    np.testing.assert_allclose(gun[:3] - turret[:3], (0.0, 0.96, 0.35), atol=0.01)
    muzzle = Rotation.from_quat(gun[3:]).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(muzzle, (0.0, np.cos(0.3), np.sin(0.3)), atol=0.01)


def test_the_same_commands_give_the_same_bytes() -> None:
    def run() -> bytes:
        with put(shipped("tank")) as simulation:
            simulation.command(NAME, asked(40 * TICK_NANOS, turret=0.3, gun=-0.05))
            drive(simulation, 0.5, (1.0, 0.1))
            return encode(simulation.vehicle_states()[NAME])  # type: ignore[arg-type]

    assert run() == run()
