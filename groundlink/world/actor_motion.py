# SPDX-License-Identifier: Apache-2.0
"""Poses of scripted actors as pure functions of sim time.

Position and heading are continuous, so a scripted actor pushes what is in its path. Only physics
evaluates the motion; other processes read the state.
"""

from bisect import bisect_right
from itertools import pairwise
from math import atan2, cos, hypot, pi, radians, sin
from typing import NamedTuple, Protocol

from groundlink.core.fields import Quaternion, Vector3

from .actors import FreeMotion, HingeMotion, Motion, PathMotion, Point
from .terrain import Ground

TURN_RADPS = pi
"""Turn rate of an actor at a point of its path."""


class ActorPose(NamedTuple):
    """Pose of an actor, upright."""

    position_m: Vector3
    yaw_rad: float

    @property
    def orientation(self) -> Quaternion:
        """Quaternion xyzw of world_from_actor."""
        return 0.0, 0.0, sin(self.yaw_rad / 2), cos(self.yaw_rad / 2)


class Mover(Protocol):
    """A scripted motion in a world."""

    def at(self, seconds: float) -> ActorPose:
        """Return world_from_actor at a sim time."""


class _Leg(NamedTuple):
    """A straight piece of a path, with the stop at its end."""

    begin_s: float
    walk_s: float
    start: Point
    end: Point
    yaw_rad: float
    turn_rad: float
    """To the heading of the next leg."""


class PathMover:
    """Moves an actor along points, back and forth or in a loop."""

    def __init__(self, motion: PathMotion, ground: Ground | None) -> None:
        self._motion, self._ground = motion, ground
        points = motion.points_m
        way = (*points, points[0]) if motion.closed else (*points, *points[-2::-1])
        headings = [atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(way)]
        self._legs: list[_Leg] = []
        self._round_s = 0.0
        for i, ((start, end), yaw) in enumerate(zip(pairwise(way), headings, strict=True)):
            turn = _least(headings[(i + 1) % len(headings)] - yaw)
            walk_s = hypot(end[0] - start[0], end[1] - start[1]) / motion.speed_mps
            self._legs.append(_Leg(self._round_s, walk_s, start, end, yaw, turn))
            self._round_s += walk_s + motion.pause_s + abs(turn) / TURN_RADPS
        self._begins = [leg.begin_s for leg in self._legs]

    def at(self, seconds: float) -> ActorPose:
        """Return world_from_actor at a sim time."""
        motion = self._motion
        since = max(0.0, seconds - motion.start_s) % self._round_s
        leg = self._legs[bisect_right(self._begins, since) - 1]
        since -= leg.begin_s
        share = min(since / leg.walk_s, 1.0)
        x, y = (a + share * (b - a) for a, b in zip(leg.start, leg.end, strict=True))
        turned = min(max(0.0, since - leg.walk_s - motion.pause_s) * TURN_RADPS, abs(leg.turn_rad))
        yaw = leg.yaw_rad + (turned if leg.turn_rad > 0 else -turned)
        return ActorPose((x, y, motion.z_m + _height(self._ground, x, y)), yaw)


class HingeMover:
    """Moves an actor about a hinge."""

    def __init__(self, motion: HingeMotion, ground: Ground | None) -> None:
        self._motion = motion
        self._position_m = on_ground(motion.at_m, ground)

    def at(self, seconds: float) -> ActorPose:
        """Return world_from_actor at a sim time."""
        motion = self._motion
        since = seconds if motion.every_s is None else seconds % motion.every_s
        angle_deg = motion.start_deg
        for swing in motion.swings:
            if since < swing.at_s:
                break
            share = min((since - swing.at_s) / swing.for_s, 1.0)
            # Cosine profile: speed is continuous, too.
            angle_deg += (swing.angle_deg - angle_deg) * (1 - cos(pi * share)) / 2
        return ActorPose(self._position_m, radians(motion.yaw_deg + angle_deg))


def mover(motion: PathMotion | HingeMotion, ground: Ground | None) -> Mover:
    """Return the mover of an actor. Without `ground`, the ground is flat at z = 0."""
    return (
        PathMover(motion, ground) if isinstance(motion, PathMotion) else HingeMover(motion, ground)
    )


def initial_pose(motion: Motion, ground: Ground | None, seconds: float = 0.0) -> ActorPose:
    """Return world_from_actor when the actor enters the world."""
    if isinstance(motion, FreeMotion):
        return ActorPose(on_ground(motion.at_m, ground), radians(motion.yaw_deg))
    return mover(motion, ground).at(seconds)


def waypoints(motion: Motion) -> list[Point]:
    """Return x and y of the points of an actor's motion."""
    return list(motion.points_m) if isinstance(motion, PathMotion) else [motion.at_m[:2]]


def on_ground(at_m: Vector3, ground: Ground | None) -> Vector3:
    """Return a world position from one whose z is above the ground."""
    x, y, z = at_m
    return x, y, z + _height(ground, x, y)


def _height(ground: Ground | None, x_m: float, y_m: float) -> float:
    return 0.0 if ground is None else float(ground.height_at(x_m, y_m))


def _least(angle_rad: float) -> float:
    """Return an angle wrapped into (-pi, pi]."""
    return pi - (pi - angle_rad) % (2 * pi)
