# SPDX-License-Identifier: Apache-2.0
"""The actions of `osc.groundlink`, on a world of points that move as they are commanded."""

import re
import tomllib
from collections.abc import Callable
from importlib import import_module
from math import cos, degrees, pi, radians, sin
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from groundlink.core.errors import UserError
from groundlink.core.frames import quaternion_from_rpy
from groundlink.episode.world_queries import SpawnQuery
from groundlink.scenario.faults import Bias, Fault, Stuck

pytest.importorskip("scenario_execution", reason="scenario-execution is not installed")

from py_trees.common import Status
from scenario_execution.actions.base_action import BaseAction

from groundlink.sim.osc import library
from groundlink.sim.osc.actions import (
    DeleteAction,
    EntityAction,
    FailSensor,
    RepairSensor,
    SpawnAction,
    parsed_fault,
)
from groundlink.sim.osc.assertions import AssertDistance, AssertPose, AssertUntouched
from groundlink.sim.osc.driving import DriveFor, DriveTo, WaitNear, WaitTraveled

ROOT = Path(__file__).resolve().parents[3]
ROVER = {"name": "rover"}
TICK_S = 0.05


class PointWorld:
    """A rover that drives as commanded, and a barrel."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.places_m = {"rover": (0.0, 0.0), "barrel": (3.0, 4.0)}
        self.heading_rad = 0.0
        self.velocity = (0.0, 0.0)
        self.contacts: dict[str, float] = {}
        self.calls: list[Any] = []

    def now(self) -> float:
        return self.now_s

    def step(self) -> None:
        self.now_s += TICK_S
        speed, turn = self.velocity
        x, y = self.places_m["rover"]
        way = speed * TICK_S
        self.places_m["rover"] = x + way * cos(self.heading_rad), y + way * sin(self.heading_rad)
        self.heading_rad += turn * TICK_S

    def command(self, vehicle: str, linear_mps: float, angular_radps: float) -> None:
        assert vehicle == "rover"
        self.velocity = linear_mps, angular_radps

    def entity(self, name: str) -> Any:
        if name not in self.places_m:
            raise UserError(f"no entity `{name}`")
        heading = self.heading_rad if name == "rover" else 0.0
        orientation = quaternion_from_rpy(0.0, 0.0, heading)
        return SimpleNamespace(position_m=(*self.places_m[name], 0.5), orientation=orientation)

    def spawn(self, query: SpawnQuery) -> None:
        self.calls.append(query)

    def delete(self, name: str) -> None:
        self.calls.append(name)

    def fault(self, sensor: str, fault: Fault | None) -> None:
        self.calls.append((sensor, fault))

    def touched(self, vehicle: str) -> dict[str, float]:
        return self.contacts

    def path(self, name: str) -> str:
        return f"here/{name}"


@pytest.fixture
def world() -> PointWorld:
    return PointWorld()


def begun(action: EntityAction, world: PointWorld, **arguments: Any) -> EntityAction:
    """Return an action that has been set up and given its arguments."""
    action.logger = SimpleNamespace(error=str, debug=str)
    action.setup(simulation=world, clock=world)
    action.execute(ROVER, **arguments)  # type: ignore[attr-defined]
    return action


def ticks(action: EntityAction, world: PointWorld, most: int = 1000) -> int:
    """Tick an action until it succeeds; return how many ticks it was under way."""
    for count in range(most):
        action.status = action.update()
        if action.status != Status.RUNNING:
            assert action.status == Status.SUCCESS, action.feedback_message
            return count
        world.step()
    raise AssertionError(f"under way after {most} ticks: {action.feedback_message}")


def declared() -> dict[str, list[str]]:
    """Return the parameters of each action of the library, in order."""
    package, file = library()
    text = (ROOT.joinpath(*package.split(".")) / "lib_osc" / file).read_text(encoding="utf-8")
    actions = re.findall(r"^action ([\w.]+)(?::\n((?: .*\n)*)|\n)", text, re.MULTILINE)
    return {name: re.findall(r"^    (\w+):", body, re.MULTILINE) for name, body in actions}


def test_each_declared_action_has_a_class_with_its_parameters() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    points = project["entry-points"]
    assert points["scenario_execution.osc_libraries"] == {
        "groundlink": "groundlink.sim.osc:library"
    }
    given = points["scenario_execution.actions"]
    assert given.keys() == declared().keys()
    for name, place in given.items():
        module, _, of_class = place.partition(":")
        action = getattr(import_module(module), of_class)
        assert issubclass(action, BaseAction)
        code = action.execute.__code__
        arguments = code.co_varnames[: code.co_argcount]
        assert list(arguments) == ["self", "associated_actor", *declared()[name]], name


def test_a_drive_ends_after_its_time_and_stops(world: PointWorld) -> None:
    drive = begun(DriveFor(ROVER), world, speed=0.8, turn_rate=0.1, duration=2.0)
    assert ticks(drive, world) == pytest.approx(2.0 / TICK_S, abs=1)
    assert world.velocity == (0.0, 0.0)
    assert degrees(world.heading_rad) == pytest.approx(degrees(0.2), abs=0.5)


@pytest.mark.parametrize("place", [(2.0, 0.0), (2.0, 2.0), (-1.0, 0.5), (0.0, -3.0)])
def test_a_drive_to_a_place_arrives(world: PointWorld, place: tuple[float, float]) -> None:
    goal = {"x": place[0], "y": place[1]}
    drive = begun(DriveTo(ROVER), world, position=goal, speed=0.8, tolerance=0.2)
    ticks(drive, world)
    assert world.velocity == (0.0, 0.0)
    x, y = world.places_m["rover"]
    assert abs(complex(x, y) - complex(*place)) <= 0.2


def test_an_abandoned_drive_stops_the_vehicle_once(world: PointWorld) -> None:
    drive = begun(DriveFor(ROVER), world, speed=0.8, turn_rate=0.0, duration=2.0)
    drive.status = drive.update()
    drive.stop(Status.INVALID)
    assert world.velocity == (0.0, 0.0)
    world.command("rover", 0.3, 0.0)
    drive.stop(Status.INVALID)
    assert world.velocity == (0.3, 0.0)


def test_a_distance_to_travel_counts_from_the_begin_of_the_wait(world: PointWorld) -> None:
    world.command("rover", 1.0, pi)
    for _ in range(40):
        world.step()
    wait = begun(WaitTraveled(ROVER), world, distance=1.0)
    assert ticks(wait, world) == pytest.approx(1.0 / TICK_S, abs=1)


def test_waiting_for_nearness_measures_between_origins(world: PointWorld) -> None:
    world.heading_rad = radians(53.13)
    world.command("rover", 1.0, 0.0)
    wait = begun(WaitNear(ROVER), world, other="barrel", distance=1.0)
    assert ticks(wait, world) == pytest.approx(4.0 / TICK_S, abs=1)


def test_the_world_is_changed_once(world: PointWorld) -> None:
    pose = {
        "position": {"x": 1.0, "y": 2.0, "z": 3.0},
        "orientation": {"roll": 0.0, "pitch": 0.0, "yaw": pi},
    }
    changes: list[tuple[Callable[..., EntityAction], dict[str, Any]]] = [
        (SpawnAction, {"what": "barrel", "pose": pose}),
        (DeleteAction, {}),
        (FailSensor, {"sensor": "imu", "fault": "{kind: stuck, for_s: 2}"}),
        (RepairSensor, {"sensor": "imu"}),
    ]
    for make, arguments in changes:
        assert ticks(begun(make(ROVER), world, **arguments), world) == 0
    spawned, *others = world.calls
    assert (spawned.uri, spawned.name) == ("here/barrel", "rover")
    assert spawned.position_m == (1.0, 2.0, 3.0)
    assert spawned.orientation == pytest.approx((0.0, 0.0, 1.0, 0.0))
    assert others == ["rover", ("rover/imu", Stuck(for_s=2.0)), ("rover/imu", None)]


AT_ORIGIN = {"position": {"x": 0.3, "y": 0.4}, "orientation": radians(10)}


@pytest.mark.parametrize(
    ("make", "arguments", "reason"),
    [
        (AssertPose, {"pose": AT_ORIGIN, "tolerance": 0.51, "angle_tolerance": pi}, None),
        (
            AssertPose,
            {"pose": AT_ORIGIN, "tolerance": 0.49, "angle_tolerance": pi},
            "at 0.000, 0.000, which is 0.500 m from 0.3, 0.4; expected at most 0.49 m",
        ),
        (
            AssertPose,
            {"pose": AT_ORIGIN, "tolerance": 1.0, "angle_tolerance": radians(9)},
            "heading 0.0 deg, which is 10.0 deg from 10 deg; expected at most 9 deg",
        ),
        (AssertDistance, {"other": "barrel", "at_least": 4.9, "at_most": 5.1}, None),
        (
            AssertDistance,
            {"other": "barrel", "at_least": 5.1, "at_most": 9.0},
            "5.000 m from `barrel`; expected 5.1 m to 9 m",
        ),
        (AssertDistance, {"other": "cat", "at_least": 0.0, "at_most": 9.0}, "no entity `cat`"),
        (AssertUntouched, {}, None),
    ],
)
def test_an_assertion_holds_or_names_what_is_so(
    world: PointWorld,
    make: Callable[..., EntityAction],
    arguments: dict[str, Any],
    reason: str | None,
) -> None:
    action = begun(make(ROVER), world, **arguments)
    assert action.update() == (Status.SUCCESS if reason is None else Status.FAILURE)
    assert action.feedback_message == (reason or "")


def test_a_touch_is_named_with_its_instant(world: PointWorld) -> None:
    world.contacts = {"barrel": 1.25, "north_wall": 3.0}
    action = begun(AssertUntouched(ROVER), world)
    assert action.update() == Status.FAILURE
    assert action.feedback_message == "touched `barrel` by 1.25 s, `north_wall` by 3.00 s"


def test_a_fault_is_read_as_in_a_scenario() -> None:
    assert parsed_fault("{kind: bias, value: 0.5}") == Bias(value=0.5)
    for text in ("{kind: bent}", "stuck", "{kind: stuck, value: 1}", "{kind"):
        with pytest.raises(UserError, match="expected a fault as in a scenario"):
            parsed_fault(text)
