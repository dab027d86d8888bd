# SPDX-License-Identifier: Apache-2.0
"""Where a vehicle drives by itself: waypoints, or a figure that begins where it stands.

Rule: one class a kind, the tag is the kind. What line on the floor that is, `groundlink.run.routes`
says; how it is followed is the driver's business.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from groundlink.core.fields import Positive, Spec

Side = Literal["left", "right"]


class RouteSpec(Spec, frozen=True, tag_field="kind", kw_only=True):
    """What every route has."""

    speed_mps: Positive = 0.5
    laps: Annotated[int, Meta(ge=1, le=1000)] = 1
    """How often it is driven; waypoints have to be `closed` for more than once."""

    wait_s: Annotated[float, Meta(ge=0, le=3600)] = 0.0
    """Sim time for which the vehicle stands still first, as programs expect that estimate gravity
    and biases at their start."""


class Waypoint(Spec, frozen=True):
    """A point on the floor, in the world, to be reached in a straight line from the one before."""

    x_m: float
    y_m: float
    speed_mps: Positive | None = None
    """On the way to it, instead of the route's."""


class Waypoints(RouteSpec, frozen=True, tag="waypoints", kw_only=True):
    """Straight lines from where the vehicle stands to the first point and on."""

    points: Annotated[tuple[Waypoint, ...], Meta(min_length=1)]
    closed: bool = False
    """Go on from the last point to the first, so that a lap ends where it began."""

    def __post_init__(self) -> None:
        if self.laps > 1 and not self.closed:
            raise ValueError("`laps` needs `closed: true`: from the last point back to the first")
        if self.closed and len(self.points) < 2:
            raise ValueError("`closed` needs two points or more")


class Circle(RouteSpec, frozen=True, tag="circle"):
    """A circle beside the vehicle, which starts on it and along it."""

    radius_m: Positive = 1.0
    turn: Side = "left"


class FigureEight(RouteSpec, frozen=True, tag="figure_eight"):
    """Two circles that touch where the vehicle starts: the first on this side, then the other."""

    radius_m: Positive = 1.0
    turn: Side = "left"


class Square(RouteSpec, frozen=True, tag="square"):
    """A square whose first side lies before the vehicle; at corners it turns on the spot."""

    side_m: Positive = 2.0
    turn: Side = "left"


class ThereAndBack(RouteSpec, frozen=True, tag="there_and_back"):
    """A line ahead, a turn on the spot, and the same line back."""

    length_m: Positive = 2.0


Route = Waypoints | Circle | FigureEight | Square | ThereAndBack

FIGURES: dict[str, type[Circle | FigureEight | Square | ThereAndBack]] = {
    "circle": Circle,
    "figure_eight": FigureEight,
    "square": Square,
    "there_and_back": ThereAndBack,
}
"""Kinds that need nothing but their name."""

DRIVER_PERIOD_TICKS = 8
"""A driver steers 50 times a second of sim time."""

COMMAND_AHEAD_TICKS = 8
"""A driver's command is stamped this long after the state that it answers."""

DRIVER_WINDOW_TICKS = DRIVER_PERIOD_TICKS + COMMAND_AHEAD_TICKS
"""How far physics may be ahead of the last state that a driver acknowledged, in fast mode.

A driver sends its command before it acknowledges every `DRIVER_PERIOD_TICKS`. The command for state
k acts in the step from k + ahead. Physics gets beyond that step only with an acknowledgement of k,
since the one before, k - period, lets it come no further than k + ahead. So every command is there
when it is due, whatever the machine does meanwhile."""
