# SPDX-License-Identifier: Apache-2.0
"""What a run under way may be told: to pause, go on, step, begin again, take in or give up things.

Rule: a wish and its answer, as JSON in a query of `control_key` and its reply. Physics does what is
wished between two ticks; sensors see nothing of a pause but that no state comes.
"""

from __future__ import annotations

from typing import Annotated

import msgspec

from groundlink.scenario.addition import Addition


class RunCommand(msgspec.Struct, frozen=True, tag_field="wish", forbid_unknown_fields=True):
    """What somebody wants of a run."""


class Pause(RunCommand, frozen=True, tag="pause"):
    """Let sim time stand still."""


class Resume(RunCommand, frozen=True, tag="resume"):
    """Let sim time go on, as the scenario's mode has it."""


class Step(RunCommand, frozen=True, tag="step"):
    """Let sim time stand still after so many ticks more."""

    ticks: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1


class Reset(RunCommand, frozen=True, tag="reset"):
    """Begin again at tick 0 with everything at its start; a run that was paused is so still."""


class Spawn(RunCommand, frozen=True, tag="spawn"):
    """Put something into the world; after a reset it is there from the start."""

    more: Addition


class Remove(RunCommand, frozen=True, tag="remove"):
    """Take a vehicle, an actor or a solid out of the world; a reset does not bring it back."""

    name: str


class Restore(RunCommand, frozen=True, tag="restore"):
    """Go on from where a saved run was; the query's payload is the file, see `journal`.

    The answer comes when the file has been read; `ControlAnswer.restoring_to` tells how it goes on.
    """


AnyRunCommand = Pause | Resume | Step | Reset | Spawn | Remove | Restore


class ControlAnswer(msgspec.Struct, frozen=True):
    """What became of a wish."""

    error: str
    """Why it could not be done; empty where it was."""

    tick: int = -1
    """The last one that was stepped to."""

    paused: bool = False
    restoring_to: int = -1
    """The tick that physics steps to again, `tick` being how far it is; -1: it restores nothing."""

    warning: str = ""
    """What is to be said of the last restore; empty for nothing."""

    failure: str = ""
    """Why the last restore was given up, after which the run is as it was; empty where it was not.
    """
