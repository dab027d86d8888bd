# SPDX-License-Identifier: Apache-2.0
"""Run commands (pause, resume, step, reset, spawn, remove, restore) and the reply of physics.

A command is JSON in a query of `control_key`; the reply is JSON as well. Physics executes a command
between two ticks. During a pause, sensors receive no states.
"""

from typing import Annotated

import msgspec

from groundlink.core.fields import Quaternion, Vector3
from groundlink.scenario.additions import Addition, SolidGroup


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


class Spawn(_RunCommand, frozen=True, tag="spawn", omit_defaults=True):
    """Add objects to the world. A reset keeps them; they then exist from tick 0."""

    more: Addition

    group: SolidGroup | None = None
    """The added solids as one entity; None: each is one of its own."""


class Remove(_RunCommand, frozen=True, tag="remove", omit_defaults=True):
    """Remove a vehicle, an actor or a solid. A reset does not restore it."""

    name: str

    parts: tuple[str, ...] = ()
    """Names of exactly the objects to remove; empty: the object with the name, or all solids whose
    names begin with it."""


class Move(_RunCommand, frozen=True, tag="move"):
    """Move static solids, as one entity. Physics journals it; there is no such command."""

    name: str
    position_m: Vector3
    """World from the entity's frame, afterwards."""

    orientation: Quaternion
    solids: dict[str, tuple[Vector3, Quaternion]]
    """Poses of its solids by name, afterwards."""


WorldChange = Spawn | Remove | Move


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
