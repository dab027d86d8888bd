# SPDX-License-Identifier: Apache-2.0
"""Repeated runs: a recorded drive with other sensors, simulated by a pipeline of processes.

Physics repeats the journal of the recording, and the sensors that changed follow it, without a bus.
"""

import math
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from groundlink.bus.pipe import PipedMessage
from groundlink.core.atomic_file import write_atomically
from groundlink.core.clock import TICK_NANOS
from groundlink.episode import journal as journals
from groundlink.episode.journal import Journal
from groundlink.monitor import pipeline
from groundlink.scenario import Scenario

from . import resimulation
from .reader import RecordedMessage, Recording
from .repeated_readings import RepeatedReadings
from .resimulation import TopicPlan
from .verifying import in_recorded_world, replay_journal


class Resimulated(NamedTuple):
    """What a resimulated file has."""

    sensors: list[str]
    """Sensors that were simulated, as `vehicle/sensor`."""

    new: int = 0
    """Count of messages that were simulated."""

    copied: int = 0
    """Count of messages that were copied; 0 for a copy of the whole file."""

    is_copy: bool = False
    """Whether nothing differs, so that the file is a copy."""


def resimulate(
    recording: Recording,
    given: Scenario,
    out: Path,
    *,
    drive: Path | None = None,
    show: Callable[[float], None] = lambda share: None,
) -> Resimulated:
    """Write a recording as it is with another scenario's sensors, weather and light.

    Parameters
    ----------
    recording
        recording whose drive is repeated.
    given
        scenario with the changes.
    out
        new file.
    drive
        file of `write_drive`; None: physics repeats the drive now.
    show
        receives the share that is done, 0 to 1.

    Raises
    ------
    UserError
        when more than sensors, weather and light differ, or a process fails.
    """
    given = in_recorded_world(recording, given)
    recorded = recording.started_as
    resimulation.check_drive(recorded, given)
    sensors = resimulation.sensors_to_simulate(recorded, given)
    with write_atomically(out) as part:
        if not sensors and {*recorded.sensor_names()} <= {*given.sensor_names()}:
            shutil.copyfile(recording.path, part)
            return Resimulated([], is_copy=True)
        again = replay_journal(recording, given)
        readings = RepeatedReadings(again.scenario, pipeline.RUN, again.epoch_nanos)
        with _followed(again, sensors, drive) as messages:
            copied, new = resimulation.write_resimulated(
                recording, readings, messages, given, part, show
            )
    return Resimulated(sensors, new, copied)


@contextmanager
def simulated(
    recording: Recording, given: Scenario, plan: TopicPlan
) -> Iterator[Iterator[RecordedMessage]]:
    """Yield the messages of simulated sensors, while they arise.

    Parameters
    ----------
    given
        scenario with the changes, which passes `resimulation.check_drive`.
    plan
        plan of the whole, or a part of it.

    Raises
    ------
    UserError
        when a process fails.
    """
    again = replay_journal(recording, given)
    readings = RepeatedReadings(again.scenario, pipeline.RUN, again.epoch_nanos)
    end = resimulation.end_nanos(recording)
    with _followed(again, plan.sensors, None) as messages:
        yield readings.read(messages, plan.simulated, plan.sensors, end)


@contextmanager
def _followed(
    journal: Journal, sensors: list[str], drive: Path | None
) -> Iterator[Iterable[PipedMessage]]:
    """Yield the messages of a drive that sensors follow; none without sensors."""
    if not sensors:
        yield ()
        return
    with ExitStack() as opened:
        file = opened.enter_context(_written(journal))
        commands = pipeline.repeated_sensors(journal.scenario, sensors, file)
        if drive is None:
            source = None
            commands.insert(0, pipeline.repeated_physics(file))
        else:
            source = opened.enter_context(drive.open("rb"))
        yield opened.enter_context(pipeline.pipeline(commands, source))


@contextmanager
def _written(journal: Journal) -> Iterator[Path]:
    """Yield the file of a journal, which is removed afterwards."""
    with tempfile.TemporaryDirectory(prefix="groundlink-") as folder:
        file = Path(folder) / "run.journal"
        journals.write(file, journals.dumped(journal))
        yield file


def write_drive(recording: Recording, out: Path) -> None:
    """Write what physics publishes on the drive of a recording, for `resimulate`.

    Raises
    ------
    UserError
        when physics fails.
    """
    journal = replay_journal(recording, recording.started_as)
    readings = RepeatedReadings(journal.scenario, pipeline.RUN, journal.epoch_nanos)
    last_nanos = readings.given_up_nanos(resimulation.end_nanos(recording))
    ticks = math.ceil((last_nanos - journal.epoch_nanos) / TICK_NANOS)
    with _written(journal) as file, out.open("wb") as opened:
        command = pipeline.repeated_physics(file, until_tick=ticks)
        pipeline.write_output(command, opened)
