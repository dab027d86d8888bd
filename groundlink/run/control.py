# SPDX-License-Identifier: Apache-2.0
"""Run commands: pause, resume, step, reset, spawn, remove, restore; and the answer of physics.

JSON in a query of `control_key` and its reply. Physics executes a command between two ticks. During
a pause, sensors receive no states.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from groundlink.scenario.schema import Addition


class _RunCommand(msgspec.Struct, frozen=True, tag_field="wish", forbid_unknown_fields=True):
    """A command to a run. The tag keeps its name of before in the JSON."""


class Pause(_RunCommand, frozen=True, tag="pause"):
    """Pause sim time."""


class Resume(_RunCommand, frozen=True, tag="resume"):
    """Resume sim time in the mode of the scenario."""


class Step(_RunCommand, frozen=True, tag="step"):
    """Advance by some ticks, then pause."""

    ticks: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1


class Reset(_RunCommand, frozen=True, tag="reset"):
    """Restart at tick 0 from the initial state; a paused run stays paused."""


class Spawn(_RunCommand, frozen=True, tag="spawn"):
    """Add objects to the world; after a reset they exist from the start."""

    more: Addition


class Remove(_RunCommand, frozen=True, tag="remove"):
    """Remove a vehicle, an actor or a solid; a reset does not restore it."""

    name: str


class Restore(_RunCommand, frozen=True, tag="restore"):
    """Restore a saved run; the payload of the query is the file, see `run.journal`.

    The answer comes after the file was read. `ControlAnswer.restoring_to` is the progress.
    """


AnyRunCommand = Pause | Resume | Step | Reset | Spawn | Remove | Restore


class ControlAnswer(msgspec.Struct, frozen=True):
    """Answer of physics: result of a command and state of the run."""

    error: str
    """Reason of a rejected command; empty if it was executed."""

    tick: int = -1
    """Tick of the newest state."""

    paused: bool = False
    restoring_to: int = -1
    """Target tick of a restore in progress, with `tick` as its progress; -1 without a restore."""

    warning: str = ""
    """Warning of the last restore; empty without one."""

    failure: str = ""
    """Reason why the last restore failed and left the run unchanged; empty otherwise."""
