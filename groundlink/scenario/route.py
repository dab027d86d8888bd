# SPDX-License-Identifier: Apache-2.0
"""Routes of vehicles with an autopilot: waypoints, or a figure relative to the spawn pose.

Each kind of route is a class; its tag is the kind. `groundlink.episode.routes` computes the path on
the floor. The driver process follows it.
"""

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Spec

Side = Literal["left", "right"]


class RouteSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """Base of all routes."""

    speed_mps: Positive = 0.5
    """Speed on the route."""

    laps: Annotated[int, Meta(ge=1, le=1000)] = 1
    """Number of laps. Waypoints must be `closed` for more than one."""

    wait_s: Annotated[float, Meta(ge=0, le=3600)] = 0.0
    """Sim time that the vehicle waits before it starts. Estimators of gravity and biases expect the
    vehicle to be stationary at their start."""


class Waypoint(Spec, frozen=True):
    """A point on the floor in the world frame, at the end of a straight line."""

    x_m: float
    """Position along the world's x axis (east)."""

    y_m: float
    """Position along the world's y axis (north)."""

    speed_mps: Positive | None = None
    """Speed on the line to this point; none: the route's speed."""


class Waypoints(RouteSpec, frozen=True, tag="waypoints", kw_only=True):
    """Straight lines from the spawn pose to the first point, then from point to point."""

    points: Annotated[tuple[Waypoint, ...], Meta(min_length=1)]
    """Points of the route, in order."""

    closed: bool = False
    """Continue from the last point to the first one, so that a lap ends where it began."""

    def __post_init__(self) -> None:
        if self.laps > 1 and not self.closed:
            raise ValueError("`laps` needs `closed: true`, which joins the last point to the first")
        if self.closed and len(self.points) < 2:
            raise ValueError("`closed` needs two points or more")


class Circle(RouteSpec, frozen=True, tag="circle"):
    """A circle through the vehicle's position, tangent to its heading."""

    radius_m: Positive = 1.0
    """Radius of the circle."""

    turn: Side = "left"
    """Side to which the vehicle turns."""


class FigureEight(RouteSpec, frozen=True, tag="figure_eight"):
    """Two circles that touch at the vehicle's position; the one on the side of `turn` is first."""

    radius_m: Positive = 1.0
    """Radius of both circles."""

    turn: Side = "left"
    """Side to which the vehicle turns first."""


class Square(RouteSpec, frozen=True, tag="square"):
    """A square whose first side is ahead of the vehicle; the vehicle turns in place at corners."""

    side_m: Positive = 2.0
    """Length of a side."""

    turn: Side = "left"
    """Side to which the vehicle turns."""


class ThereAndBack(RouteSpec, frozen=True, tag="there_and_back"):
    """A straight line ahead, a turn in place, and the same line back."""

    length_m: Positive = 2.0
    """Length of the line."""


Route = Waypoints | Circle | FigureEight | Square | ThereAndBack

FIGURES: dict[str, type[Circle | FigureEight | Square | ThereAndBack]] = {
    "circle": Circle,
    "figure_eight": FigureEight,
    "square": Square,
    "there_and_back": ThereAndBack,
}
"""Kinds of routes that can be given by their name alone."""

DRIVER_PERIOD_TICKS = 8
"""Period of the driver, in ticks: it steers 50 times per second of sim time."""

COMMAND_AHEAD_TICKS = 8
"""Time from a state to the stamp of the driver's command for it, in ticks."""

DRIVER_WINDOW_TICKS = DRIVER_PERIOD_TICKS + COMMAND_AHEAD_TICKS
"""How far physics may be ahead of the last state that a driver acknowledged, in fast mode.

A driver sends its command before it acknowledges every `DRIVER_PERIOD_TICKS`. The command for state
k acts in the step from k + ahead. Physics passes that step only after an acknowledgement of k,
since the previous one, k - period, allows it to reach k + ahead at most. Every command is therefore
present when it is due, at any speed of the machine.
"""
