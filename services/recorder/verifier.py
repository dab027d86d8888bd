# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.recorder.verifier``: compares a run with a recording of it.

Rule: a recorder in all but its file: what it would write is compared with what was written then.
It stands in for the sensors that were not there, for which physics would wait.
"""

from __future__ import annotations

import threading
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import msgspec

from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.recording.comparison import Comparison
from groundlink.recording.missing_readings import left_out
from groundlink.recording.reader import Recording
from groundlink.recording.verifying import (
    compared_messages,
    compared_span,
    later_sensors,
    not_compared,
    silent_sensors,
    with_later_vehicles,
)
from groundlink.ros.base import made_topics
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC
from groundlink.ros.streams import outgoing

from .recorder import Recorder
from .runner import NAME, record


class _Topic:
    """A topic of which everything is compared."""

    def __init__(self, comparison: Comparison, name: str, ros_type: str) -> None:
        self._comparison, self._name, self._ros_type = comparison, name, ros_type

    def write(self, nanos: int, cdr: memoryview) -> None:
        """Compare a message."""
        self._comparison.take(self._name, self._ros_type, nanos, cdr)


class _Ignored:
    """A topic that is not compared."""

    def write(self, nanos: int, cdr: memoryview) -> None:
        """Do nothing."""


class ReferenceComparison:
    """Compares the messages of a run with a recording (a `RecordingFiles` and `RecordingFile`).

    Parameters
    ----------
    promised
        topics of which something comes for sure.
    """

    size_bytes = 0

    def __init__(
        self, recording: Recording, comparison: Comparison, promised: Collection[str]
    ) -> None:
        self._recording, self._comparison, self._promised = recording, comparison, promised
        # Earlier versions recorded less of what is made of the rest, and ordered recordings have no
        # diagnostics.
        made = made_topics(recording.run.scenario)
        self._ignored = {DIAGNOSTICS_TOPIC, *not_compared(recording), *made}
        self._topics: dict[str, _Topic | _Ignored] = {}
        self._has_begun = False

    def begin(self, epoch_nanos: int) -> ReferenceComparison:
        """Begin the comparison.

        Raises
        ------
        UserError
            when physics has begun anew in the middle of it.
        """
        if self._has_begun:
            raise UserError("physics has ended and begun anew, so nothing is compared; try again")
        self._has_begun = True
        return self

    def topic(self, name: str, ros_type: str, *, latched: bool = False) -> _Topic | _Ignored:
        """Return the topic of this name and type."""
        if name not in self._topics:
            if name in self._ignored:
                self._topics[name] = _Ignored()
            else:
                self._topics[name] = _Topic(self._comparison, name, ros_type)
                if name in self._promised:
                    self._comparison.declare(name, ros_type, name in self._recording.types)
        return self._topics[name]

    def commit(self, declared_hz: Mapping[str, float | None]) -> None:
        """Do nothing: nothing is written."""

    def close(self) -> None:
        """Do nothing."""

    def tend(self, recorder: Recorder) -> None:
        """Do nothing."""

    def finish(self, recorder: Recorder) -> None:
        """Refuse to judge by a part.

        Raises
        ------
        UserError
            when this process was too slow for the run.
        """
        if recorder.dropped:
            raise UserError(
                "messages came faster than they could be compared; give the machine less to do"
            )


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Compare until all of the recording has come again, or `stop` is set."""
    parser = process.parser(NAME, "Compare a run with a recording of it, byte for byte.")
    parser.add_argument("recording", type=Path, metavar="RUN.mcap", help="what to compare with")
    parser.add_argument(
        "--verdict", type=Path, required=True, metavar="FILE.json", help="where to write it"
    )
    options = parser.parse_args(arguments)
    with Recording(options.recording) as recording, Bus(connect=process.endpoint(options)) as bus:
        run, scenario = join(bus, options.run, stop)
        scenario = with_later_vehicles(recording, scenario)
        wanted = compared_span(recording)
        comparison = Comparison(compared_messages(recording), wanted, left_out(recording))
        duration = wanted.end_nanos - recording.run.epoch_nanos
        absent = {*silent_sensors(recording, scenario), *later_sensors(recording)}
        promised = {stream.topic for stream in outgoing(scenario, run)}
        again = ReferenceComparison(recording, comparison, promised)
        record(bus, scenario, run, again, duration, stop, absent=absent)
        if not stop.is_set():
            options.verdict.write_bytes(msgspec.json.encode(comparison.verdicts()))


if __name__ == "__main__":
    process.run(NAME, main)
