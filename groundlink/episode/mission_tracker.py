# SPDX-License-Identifier: Apache-2.0
"""Tracks the mission of a vehicle: timed states, commands and contacts in, a verdict out.

The same calls give the same verdict, live and from a recording. A vehicle that nobody commands is
never stuck.
"""

from bisect import insort
from collections import deque
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import copysign, cos, dist, hypot, isfinite, pi, radians
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.quaternions import heading_rad, rotate
from groundlink.messages.base import BusMessage, Command, WheelCommand, floats
from groundlink.messages.navigation import JointState
from groundlink.scenario.running_gear import Omnidirectional, SideSteered
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.vehicle import VehicleModel
from groundlink.scene.build import solids
from groundlink.world.bounds import Bounds, bounds

from .mission import (
    DRIVING,
    DROWNED,
    FALLING,
    LEFT,
    STANDING,
    STUCK,
    TIPPED,
    Mission,
    MissionEvent,
)
from .routes import Leg, line

PERIOD_SECONDS = 0.1
"""States are judged ten times per second of sim time: a car at 14 m/s moves 1.4 m meanwhile."""

COMMANDED_MPS = 0.02
COMMANDED_RADPS = 0.02
"""Slower commands count as standstill. The shipped driver commands 0.05 m/s and more."""

STUCK_SECONDS = 3.0
"""A vehicle is stuck after this long without progress. The slowest shipped one, the tank, has moved
0.5 m a second after its first command."""

PROGRESS_SHARE = 0.1
"""Less than this share of the commanded motion is no progress, as of wheels that spin in mud."""

DEMANDED_M = 0.06
DEMANDED_RAD = 0.06
"""Commands must add up to this much in `STUCK_SECONDS` to show that a vehicle is stuck. When it
hunts around its goal, a controller commands as much ahead as back."""

TIPPED_DEG = 60.0
"""Farther from upright no vehicle drives: tires with a friction of 1 slide off at 45 degrees, and
springs add up to 13 degrees."""

TIPPED_SECONDS = 1.0
"""A vehicle that rears up over a bump is back on its wheels earlier."""

FALLING_MPS = 3.0
"""Downward speed of a fall: reached after 0.46 m. A vehicle whose top speed is higher falls when it
is faster than downhill on a slope of 45 degrees."""

FALLING_SECONDS = 0.3
"""A drop of 0.5 m, which every shipped vehicle survives, ends earlier."""

BELOW_M = 1.0
"""A base this far below all of the world has left it."""

ROUTE_SEARCH_M = 1.0
"""Range ahead of the reached point of the route, beyond the distance moved, in which the next one
is searched; that of the shipped driver."""

TOUCHED_SECONDS = 0.5
"""A contact counts for this long: contacts are reported ten times per second."""

MAX_WAITING = 1000
"""Commands that wait for their time; more have stamps of another clock."""

MAX_EVENTS = 100
"""Events kept of one vehicle; later ones only count as time."""

DELAYS = {
    LEFT: 0.0,
    FALLING: FALLING_SECONDS,
    TIPPED: TIPPED_SECONDS,
    DROWNED: 0.0,
    STUCK: STUCK_SECONDS,
}
"""Failures, the worst first, and how long each must last to count."""


def world_box(scenario: Scenario) -> Bounds | None:
    """Return the corners of the box around a scenario's solids and terrain; None without any."""
    boxes = [bounds(solid) for solid in solids(scenario)]
    if terrain := scenario.world.terrain:
        boxes.append((np.array(terrain.low_m), np.array(terrain.high_m)))
    if not boxes:
        return None
    lows, highs = zip(*boxes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def wheels_twist(model: VehicleModel, speeds_radps: Mapping[str, float]) -> tuple[float, float]:
    """Return the velocity, m/s and rad/s, for which driven shafts turn at these speeds.

    The turn of a vehicle that is steered by its wheels' angles is left out. The speed of a base
    that drives sideways has no sign.
    """
    if isinstance(model.drive, Omnidirectional):
        rows = np.array(model.drive.rows(model.wheels))
        named = (s.name for s in model.drive.shafts(model.wheels) if s.driven)
        speeds = np.array([speeds_radps.get(name, 0.0) for name in named])
        forward, left, turn = np.linalg.lstsq(rows, speeds)[0].tolist()
        return hypot(forward, left), turn
    sides: tuple[list[float], list[float]] = ([], [])
    places: list[float] = []
    for shaft in model.drive.shafts(model.wheels):
        if shaft.driven:
            y_m = model.wheels[shaft.wheels[0]].center_m[1]
            sides[y_m > 0].append(speeds_radps.get(shaft.name, 0.0) * shaft.radius_m)
            places.append(y_m)
    if not places:
        return 0.0, 0.0
    right, left = (sum(side) / len(side) for side in sides)
    if not isinstance(model.drive, SideSteered):
        return (left + right) / 2, 0.0
    track_m = (max(places) - min(places)) * model.drive.track_multiplier
    return (left + right) / 2, (right - left) / track_m


def commanded_twist(model: VehicleModel, message: BusMessage) -> tuple[float, float] | None:
    """Return the velocity, m/s and rad/s, that a message commands; None for no command."""
    match message:
        case Command():
            forward, left, _ = message.linear_mps
            drives_sideways = isinstance(model.drive, Omnidirectional)
            return hypot(forward, left) if drives_sideways else forward, message.angular_radps[2]
        case WheelCommand():
            return wheels_twist(model, message.speeds_radps)
        case JointState():
            speeds = floats(message.velocities).tolist()
            of_joints = dict(zip(message.names, speeds, strict=False))
            shafts = (shaft.name for shaft in model.drive.shafts(model.wheels) if shaft.driven)
            of_wheels = {name: of_joints[name] for name in shafts if name in of_joints}
            return wheels_twist(model, of_wheels) if of_wheels else None
    return None


class RouteProgress:
    """How far a vehicle is along its route. Later parts count only after earlier ones."""

    def __init__(self, vehicle: Vehicle) -> None:
        assert vehicle.route is not None
        start = vehicle.placement
        along = line(
            vehicle.route,
            start_m=(start.x_m, start.y_m),
            heading_rad=radians(start.yaw_deg),
        )
        self._leg = Leg(along.points_m, along.speeds_mps) if len(along.speeds_mps) else None
        self._reached_m = 0.0
        self.apart_m = 0.0
        """Distance of the base from the reached part of the route; 0 without a length."""

        self._place: tuple[float, float] | None = None

    def moved(self, x_m: float, y_m: float) -> None:
        """Take the position of the base in the world."""
        if self._leg is None:
            return
        here = np.array([x_m, y_m])
        if self._place is None:
            found, apart = self._leg.nearest(here, 0.0, ROUTE_SEARCH_M)
            if apart > ROUTE_SEARCH_M:  # The observer has joined later.
                found, apart = self._leg.nearest(here, 0.0, self._leg.length_m)
        else:
            ahead = ROUTE_SEARCH_M + dist(self._place, (x_m, y_m))
            found, apart = self._leg.nearest(here, self._reached_m, self._reached_m + ahead)
        self._place, self._reached_m, self.apart_m = (x_m, y_m), found, apart

    @property
    def share(self) -> float:
        """Share of the route, 0..1."""
        return 1.0 if self._leg is None else min(1.0, self._reached_m / self._leg.length_m)


class _Row(NamedTuple):
    """A state, and what was commanded and turned since the vehicle was last commanded to stop."""

    seconds: float
    position_m: Vector3
    asked_m: float = 0.0
    asked_rad: float = 0.0
    turned_rad: float = 0.0


class _LatestMotion:
    """Commands and motion of the last `STUCK_SECONDS`."""

    def __init__(self) -> None:
        self._rows: deque[_Row] = deque()

    @property
    def begin(self) -> _Row:
        """The oldest state."""
        return self._rows[0]

    def restart(self, seconds: float, position_m: Vector3) -> None:
        """Forget everything before this state."""
        self._rows = deque([_Row(seconds, position_m)])

    def add(self, move: _Row) -> None:
        """Take a state with what was commanded and turned since the one before."""
        last, rows = self._rows[-1], self._rows
        sums = (a + b for a, b in zip(last[2:], move[2:], strict=True))
        rows.append(_Row(move.seconds, move.position_m, *sums))
        while len(rows) > 1 and move.seconds - rows[1].seconds >= STUCK_SECONDS - 1e-6:
            rows.popleft()

    def is_stuck(self) -> bool:
        """Return whether commands for `STUCK_SECONDS` moved the vehicle nowhere."""
        first, last = self._rows[0], self._rows[-1]
        if last.seconds - first.seconds < STUCK_SECONDS - 1e-6:
            return False
        asked_m, asked_rad = last.asked_m - first.asked_m, last.asked_rad - first.asked_rad
        turned = copysign(1.0, asked_rad) * (last.turned_rad - first.turned_rad)
        moved = dist(first.position_m, last.position_m)
        drives, turns = abs(asked_m) >= DEMANDED_M, abs(asked_rad) >= DEMANDED_RAD
        has_driven = drives and moved >= PROGRESS_SHARE * abs(asked_m)
        has_turned = turns and turned >= PROGRESS_SHARE * abs(asked_rad)
        return (drives or turns) and not (has_driven or has_turned)


@dataclass
class _Condition:
    """A failure that may have begun."""

    seconds: float
    position_m: Vector3
    event: MissionEvent | None = None
    """Set once it has lasted long enough."""


@dataclass
class _Sums:
    driven_m: float = 0.0
    commanded_m: float = 0.0
    followed_m: float = 0.0
    commanded_rad: float = 0.0
    turned_rad: float = 0.0


@dataclass
class _Pose:
    seconds: float
    position_m: Vector3
    ahead: Vector3
    """Direction of the base's x axis in the world."""

    yaw_rad: float


@dataclass
class _Command:
    """The velocity that the vehicle's controller takes from the commands."""

    asked: tuple[float, float] = (0.0, 0.0)
    since_seconds: float = float("-inf")
    ramped: tuple[float, float] = (0.0, 0.0)
    waiting: list[tuple[float, float, float]] = field(default_factory=list)
    """Commands that act later: time (s), m/s, rad/s."""

    @property
    def is_motion(self) -> bool:
        """Whether the controller takes more than a standstill from the commands."""
        speed, turn = self.ramped
        return abs(speed) >= COMMANDED_MPS or abs(turn) >= COMMANDED_RADPS


class MissionTracker:
    """Tracks the mission of one vehicle.

    Parameters
    ----------
    box
        corners of the world, as `world_box` returns them; None: it has no edge.
    hold
        how many times the drive's timeout a command is valid; more than 1 where only every n-th
        command is passed on.
    """

    def __init__(self, vehicle: Vehicle, box: Bounds | None, *, hold: int = 1) -> None:
        self.vehicle = vehicle
        self._drive = vehicle.model.drive
        self._top_mps = vehicle.model.top_speed_mps
        self._timeout_seconds = hold * self._drive.command_timeout_s
        self._falling_mps = max(FALLING_MPS, self._top_mps * cos(pi / 4))
        self._box = None if box is None else (box[0].tolist(), box[1].tolist())
        self._route = None if vehicle.route is None else RouteProgress(vehicle)
        self._pose: _Pose | None = None
        self._latest = _LatestMotion()
        self._command = _Command()
        self._touched: dict[str, float] = {}
        self._has_drowned = False
        self._conditions: dict[str, _Condition] = {}
        self._events: list[MissionEvent] = []
        self._stuck_seconds = 0.0
        self._sums = _Sums()

    def commanded(self, seconds: float, speed_mps: float, turn_radps: float) -> None:
        """Take a command with the time from which it acts. One that is not finite is ignored."""
        if isfinite(speed_mps) and isfinite(turn_radps):
            insort(self._command.waiting, (seconds, speed_mps, turn_radps))
            del self._command.waiting[MAX_WAITING:]

    def touched(self, seconds: float, names: Iterable[str]) -> None:
        """Take the names of all that the vehicle touches, besides the ground under its wheels."""
        self._touched |= dict.fromkeys(names, seconds)

    def drowned(self) -> None:
        """Take that the motors have stopped in deep water."""
        self._has_drowned = True

    def moved(self, seconds: float, position_m: Vector3, orientation: Quaternion) -> None:
        """Take a state: the pose of the base in the world. Times increase."""
        last = self._pose
        if last is not None and seconds - last.seconds < PERIOD_SECONDS - 1e-6:
            return
        yaw = heading_rad(orientation)
        ahead = rotate(orientation, (1.0, 0.0, 0.0))
        self._pose = pose = _Pose(seconds, position_m, ahead, yaw)
        speed, turn = self._active(seconds, 0.0 if last is None else seconds - last.seconds)
        if self._route is not None:
            self._route.moved(*position_m[:2])
        downward_mps = 0.0
        if last is not None:
            self._integrate(last, pose, speed, turn)
            downward_mps = (last.position_m[2] - position_m[2]) / (seconds - last.seconds)
        is_given_up = self._is_silent(seconds) and self._is_known(STUCK)
        if last is None or not (self._command.is_motion or is_given_up):
            self._latest.restart(seconds, position_m)
        x, y, *_ = orientation
        upright = 1 - 2 * (x * x + y * y)
        self._judge(LEFT, self._is_outside(position_m), seconds, position_m)
        self._judge(FALLING, downward_mps > self._falling_mps, seconds, position_m)
        self._judge(TIPPED, upright < cos(radians(TIPPED_DEG)), seconds, position_m)
        self._judge(DROWNED, self._has_drowned, seconds, position_m)
        begin, is_stuck = self._latest.begin, self._latest.is_stuck() or is_given_up
        self._judge(STUCK, is_stuck, begin.seconds, begin.position_m)

    def _active(self, seconds: float, passed: float) -> tuple[float, float]:
        """Return the velocity that is commanded now, within the vehicle's limits."""
        command, drive = self._command, self._drive
        while command.waiting and command.waiting[0][0] <= seconds:
            since, speed, turn = command.waiting.pop(0)
            if since >= command.since_seconds:
                command.since_seconds, command.asked = since, (speed, turn)
        asked = command.asked
        if self._is_silent(seconds):
            asked = (0.0, 0.0)
        limited = max(-self._top_mps, min(self._top_mps, asked[0]))
        command.ramped = (
            _towards(command.ramped[0], limited, drive.max_acceleration_mps2 * passed),
            _towards(command.ramped[1], asked[1], drive.max_angular_acceleration_radps2 * passed),
        )
        return command.ramped

    def _is_silent(self, seconds: float) -> bool:
        """Return whether commands ended without one to stop, as when their sender has ended."""
        since = self._command.since_seconds
        return self._command.asked != (0.0, 0.0) and seconds - since > self._timeout_seconds

    def _is_known(self, state: str) -> bool:
        """Return whether the vehicle is in a failure for long enough."""
        condition = self._conditions.get(state)
        return condition is not None and condition.event is not None

    def _integrate(self, last: _Pose, pose: _Pose, speed: float, turn: float) -> None:
        """Add the motion since the last state, and the motion that was commanded."""
        sums, passed = self._sums, pose.seconds - last.seconds
        move = [b - a for a, b in zip(last.position_m, pose.position_m, strict=True)]
        along = sum(m * (a + b) / 2 for m, a, b in zip(move, last.ahead, pose.ahead, strict=True))
        turned = (pose.yaw_rad - last.yaw_rad + pi) % (2 * pi) - pi
        sums.driven_m += dist(last.position_m, pose.position_m)
        if abs(speed) >= COMMANDED_MPS:
            sums.commanded_m += abs(speed) * passed
            sums.followed_m += copysign(1.0, speed) * along
        if abs(turn) >= COMMANDED_RADPS:
            sums.commanded_rad += abs(turn) * passed
            sums.turned_rad += copysign(1.0, turn) * turned
        self._latest.add(_Row(pose.seconds, pose.position_m, speed * passed, turn * passed, turned))

    def _is_outside(self, position_m: Vector3) -> bool:
        if self._box is None:
            return False
        low, high = self._box
        x, y, z = position_m
        is_beside = not (low[0] <= x <= high[0] and low[1] <= y <= high[1])
        return is_beside or z < low[2] - BELOW_M

    def _judge(self, state: str, holds: bool, seconds: float, position_m: Vector3) -> None:
        """Begin, continue or end a failure, which would have begun at that time and place."""
        assert self._pose is not None
        now = self._pose.seconds
        if not holds:
            ended = self._conditions.pop(state, None)
            if ended is not None and ended.event is not None:
                self._stuck_seconds += now - ended.seconds if state == STUCK else 0.0
                if len(self._events) < MAX_EVENTS:
                    self._events.append(replace(ended.event, end_seconds=now))
            return
        condition = self._conditions.setdefault(state, _Condition(seconds, position_m))
        if condition.event is None and now - condition.seconds >= DELAYS[state] - 1e-6:
            condition.event = MissionEvent(
                state,
                condition.seconds,
                None,
                condition.position_m,
                self._command.asked,
                tuple(n for n, at in self._touched.items() if now - at <= TOUCHED_SECONDS),
            )

    def present(self) -> list[MissionEvent]:
        """Return the failures that the vehicle is in at the last state, the worst first."""
        return [c.event for c in map(self._conditions.get, DELAYS) if c and c.event]

    def mission(self) -> Mission:
        """Return the figures up to the last state."""
        present = self.present()
        seconds = 0.0 if self._pose is None else self._pose.seconds
        stuck = sum(seconds - event.begin_seconds for event in present if event.state == STUCK)
        ending = present[0] if present else None
        sums = self._sums
        return Mission(
            vehicle=self.vehicle.name,
            state=ending.state if ending else DRIVING if self._command.is_motion else STANDING,
            seconds=seconds,
            route_share=None if self._route is None else self._route.share,
            driven_m=sums.driven_m,
            commanded_m=sums.commanded_m,
            followed_m=sums.followed_m,
            commanded_rad=sums.commanded_rad,
            turned_rad=sums.turned_rad,
            stuck_seconds=self._stuck_seconds + stuck,
            events=tuple(self._events),
            ending=ending,
            fix="" if ending is None else self._fix(ending),
        )

    def _fix(self, event: MissionEvent) -> str:
        """Return what to try against a failure."""
        if event.state == LEFT and self._box is not None:
            (west, south, _), (east, north, _) = self._box
            return (
                f"keep it between x {west:g} and {east:g} m, y {south:g} and {north:g} m, or give "
                "the world more ground"
            )
        if event.state == STUCK and event.touching:
            return "steer clear of what it touches"
        if event.state == STUCK and self._cannot_turn(event.command):
            return "command a speed with each turn, since it cannot turn on the spot"
        return _FIXES[event.state]

    def _cannot_turn(self, command: tuple[float, float]) -> bool:
        """Return whether a command is a turn on the spot that the vehicle cannot make."""
        return self.vehicle.model.least_radius_m > 0 and abs(command[0]) < COMMANDED_MPS


_FIXES = {
    FALLING: "put ground below it, or end its route before the edge",
    TIPPED: "turn more slowly or take gentler slopes; `groundlink try` tells where it tips",
    DROWNED: "end its route before water deeper than `wading.depth_m` of its model",
    STUCK: "check torque, friction and wheels in the air with `groundlink try VEHICLE.yaml`",
}


def _towards(value: float, target: float, most: float) -> float:
    """Return `value` moved toward `target`, by at most `most`."""
    return value + max(-most, min(most, target - value))
