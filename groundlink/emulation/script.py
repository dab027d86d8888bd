# SPDX-License-Identifier: Apache-2.0
"""Link script: how both directions of a link change during a run.

An event names only the fields that change. A script is checked completely when it is created;
changes during a run pass the same checks.
"""

from typing import Annotated, Any

import msgspec
from msgspec import Meta

from groundlink.core.errors import did_you_mean
from groundlink.core.fields import NonNegative, Spec

from .settings import Impairment

DIRECTIONS = ("to_ros", "from_ros")
Changes = dict[str, float | bool]


class LinkEvent(Spec, frozen=True, kw_only=True):
    """New values of fields from `at_s` seconds of sim time on."""

    at_s: NonNegative
    """Sim time of the event."""

    to_ros: Changes = msgspec.field(default_factory=dict)
    """New values of impairments towards ROS, by field."""

    from_ros: Changes = msgspec.field(default_factory=dict)
    """New values of impairments from ROS, by field."""


class LinkScript(Spec, frozen=True, kw_only=True):
    """Initial impairments of a link, and events.

    Raises
    ------
    ValueError
        if an event names an unknown field or an invalid value.
    """

    seed: Annotated[int, Meta(ge=0)] = 0
    """Seed of the random losses, delays and bit errors."""

    to_ros: Impairment = Impairment()
    """Initial impairments of datagrams from the gateway to ROS."""

    from_ros: Impairment = Impairment()
    """Initial impairments of datagrams from ROS to the gateway."""

    events: tuple[LinkEvent, ...] = ()
    """Changes during the run, in any order."""

    def __post_init__(self) -> None:
        ScriptPlayer(self).at(float("inf"))


class ScriptPlayer:
    """Plays a link script."""

    def __init__(self, script: LinkScript) -> None:
        self._script = script
        self._events = sorted(script.events, key=lambda event: event.at_s)
        self._now = 0.0
        self._begin()

    def at(self, sim_seconds: float) -> dict[str, Impairment]:
        """Return the settings of each direction at a sim time; earlier times restart the script."""
        if sim_seconds < self._now:
            self._begin()
        self._now = sim_seconds
        while self._next < len(self._events) and self._events[self._next].at_s <= sim_seconds:
            event = self._events[self._next]
            self._next += 1
            for direction in DIRECTIONS:
                self.change(direction, getattr(event, direction), f"event at {event.at_s:g} s: ")
        return self.now()

    def now(self) -> dict[str, Impairment]:
        """Return the current settings of each direction."""
        return dict(self._settings)

    def change_all(self, changes: dict[str, Changes]) -> None:
        """Change fields of several directions, all or none; errors are those of `change`."""
        before = self.now()
        try:
            for direction, fields in changes.items():
                self.change(direction, fields)
        except ValueError:
            self._settings = before
            raise

    def change(self, direction: str, changes: Changes, where: str = "") -> None:
        """Change fields of one direction; later events still apply.

        Raises
        ------
        ValueError
            if the direction or field is unknown, or the value is invalid.
        """
        if direction not in DIRECTIONS:
            raise ValueError(
                f"{where}unknown direction `{direction}`; expected {' or '.join(DIRECTIONS)}"
            )
        try:
            self._settings[direction] = changed(self._settings[direction], changes)
        except ValueError as error:
            raise ValueError(f"{where}{direction}: {error}") from None

    def _begin(self) -> None:
        self._settings = {name: getattr(self._script, name) for name in DIRECTIONS}
        self._next = 0


def parse_changes(text: str) -> dict[str, Changes]:
    """Return changes by direction from a text such as `to_ros.loss=0.1;from_ros.outage=true`.

    Raises
    ------
    ValueError
        if the text is malformed.
    """
    changes: dict[str, Changes] = {}
    for part in filter(None, text.split(";")):
        where, equals, value = part.partition("=")
        direction, dot, field = where.partition(".")
        try:
            parsed = {"true": True, "false": False}.get(value) if value.isalpha() else float(value)
        except ValueError:
            parsed = None
        if not equals or not dot or parsed is None:
            raise ValueError(f"`{part}`: expected DIRECTION.FIELD=VALUE such as to_ros.loss=0.1")
        changes.setdefault(direction, {})[field] = parsed
    return changes


def changed(settings: Impairment, changes: dict[str, Any]) -> Impairment:
    """Return the settings with some fields replaced.

    Raises
    ------
    ValueError
        if a field is unknown or a value is invalid.
    """
    fields = msgspec.to_builtins(settings)
    for name in changes:
        if name not in fields:
            raise ValueError(f"unknown field `{name}`; {did_you_mean(name, fields)}")
    try:
        return msgspec.convert(fields | changes, Impairment)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        field = where.rstrip("`")
        given = f"`{field}`: " if field else ""
        raise ValueError(f"{given}{problem[:1].lower()}{problem[1:]}") from None
