# SPDX-License-Identifier: Apache-2.0
"""Verdict on the mission of a vehicle: what it was commanded, what it did, and how it ended.

`mission_tracker` computes it from states and commands.
"""

from typing import Any

import msgspec

from groundlink.core.fields import Vector3

STANDING, DRIVING = "standing", "driving"
LEFT, FALLING, TIPPED = "left the map", "falling", "tipped over"
DROWNED, STUCK = "drowned", "stuck"

FOLLOWED_SHARE = 0.5
"""A vehicle that does less of what is commanded is reported, wherever it ends. Shipped vehicles
do 95 % and more on their routes."""

LEAST_M = 0.5
LEAST_RAD = 0.5
"""Shares of less commanded motion say nothing."""


class MissionEvent(msgspec.Struct, frozen=True):
    """A time in which a vehicle was stuck, drowned, tipped over, falling or off the map."""

    state: str
    begin_seconds: float
    end_seconds: float | None
    """None: it had not ended."""

    position_m: Vector3
    """Position of the base in the world at its begin."""

    command: tuple[float, float]
    """Commanded velocity, m/s and rad/s, when it was found."""

    touching: tuple[str, ...] = ()
    """What the vehicle touched then, besides the ground under its wheels."""

    def described(self) -> str:
        """Return the event as text."""
        x, y = (round(value, 2) + 0.0 for value in self.position_m[:2])  # No minus zero.
        when = f"since {self.begin_seconds:.1f} s"
        if self.end_seconds is not None:
            when = f"from {self.begin_seconds:.1f} to {self.end_seconds:.1f} s"
        words = f"{self.state} at x {x:.2f}, y {y:.2f} m {when}"
        if self.state == STUCK:
            speed, turn = self.command
            words += f" (commanded {speed:.2f} m/s, {turn:.2f} rad/s)"
        touching = ", ".join(f"`{name}`" for name in self.touching)
        return f"{words}, touching {touching}" if touching else words


class Mission(msgspec.Struct, frozen=True):
    """Figures of one vehicle from the first state to the last."""

    vehicle: str
    state: str
    """At the end: standing, driving, stuck, drowned, tipped over, falling or left the map."""

    seconds: float
    """Sim time of the last state."""

    route_share: float | None
    """Share of the scenario's route that was driven, 0..1; none: no route."""

    driven_m: float
    """Length of the path."""

    commanded_m: float
    """Length of the path that was commanded."""

    followed_m: float
    """Motion in the commanded direction, ahead or back."""

    commanded_rad: float
    turned_rad: float
    """Turns that were commanded, and turns in the commanded direction."""

    stuck_seconds: float
    events: tuple[MissionEvent, ...]
    """Failures that ended before the last state, in the order of their ends."""

    ending: MissionEvent | None = None
    """The failure that the mission ended in; none: the vehicle could have continued."""

    fix: str = ""
    """What to try against it."""

    @property
    def speed_share(self) -> float | None:
        """Driven share of the commanded path; none: too little was commanded."""
        return self.followed_m / self.commanded_m if self.commanded_m >= LEAST_M else None

    @property
    def turn_share(self) -> float | None:
        """Turned share of the commanded turns; none: too little was commanded."""
        return self.turned_rad / self.commanded_rad if self.commanded_rad >= LEAST_RAD else None

    def to_builtins(self) -> dict[str, Any]:
        """Return plain data, with the shares and the line of `failure`, for JSON."""
        derived = {"speed_share": self.speed_share, "turn_share": self.turn_share}
        return {**msgspec.to_builtins(self), **derived, "failure": self.failure()}

    def failure(self) -> str | None:
        """Return one line on how the mission ended badly: what, where, when, and what to try."""
        if self.ending is None:
            return None
        return f"{self.vehicle}: {self.ending.described()}. Fix: {self.fix}"

    def problems(self) -> list[str]:
        """Return all that was not as it should be as lines; what it ended in is the first."""
        lines = list(filter(None, [self.failure()]))
        lines += [f"{self.vehicle} was {event.described()}" for event in self.events]
        for share, done, asked, unit in (
            (self.speed_share, self.followed_m, self.commanded_m, "m"),
            (self.turn_share, self.turned_rad, self.commanded_rad, "rad"),
        ):
            if share is not None and share < FOLLOWED_SHARE:
                verb = "drove" if unit == "m" else "turned"
                lines.append(f"{self.vehicle} {verb} {done:.1f} of {asked:.1f} {unit} commanded")
        return lines
