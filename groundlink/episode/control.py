# SPDX-License-Identifier: Apache-2.0
"""Run commands (pause, resume, step, reset, spawn, remove, restore) and the reply of physics.

A command is JSON in a query of `control_key`; the reply is JSON as well. Physics executes a command
between two ticks. During a pause, sensors receive no states.
"""

from typing import Annotated

import msgspec

from groundlink.scenario.schema import Addition


class _RunCommand(msgspec.Struct, frozen=True, tag_field="wish", forbid_unknown_fields=True):
    """Base of the run commands. In the JSON, the tag keeps its former name `wish`."""


class Pause(_RunCommand, frozen=True, tag="pause"):
    """Pause sim time."""


class Resume(_RunCommand, frozen=True, tag="resume"):
    """Resume sim time in the mode of the scenario."""


class Step(_RunCommand, frozen=True, tag="step"):
    """Advance by a number of ticks, then pause."""

    ticks: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1


class Reset(_RunCommand, frozen=True, tag="reset"):
    """Restart at tick 0 from the initial state. A paused run stays paused."""


class Spawn(_RunCommand, frozen=True, tag="spawn"):
    """Add objects to the world. A reset keeps them; they then exist from tick 0."""

    more: Addition


class Remove(_RunCommand, frozen=True, tag="remove"):
    """Remove a vehicle, an actor or a solid. A reset does not restore it."""

    name: str


class Restore(_RunCommand, frozen=True, tag="restore"):
    """Restore a saved run. The payload of the query is the file; see `run.journal`.

    Physics replies after it has read the file. `ControlAnswer.restoring_to` gives the progress.
    """


AnyRunCommand = Pause | Resume | Step | Reset | Spawn | Remove | Restore


class ControlAnswer(msgspec.Struct, frozen=True):
    """Reply of physics: result of the command and state of the run."""

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
