# SPDX-License-Identifier: Apache-2.0
"""Verifier process, started with ``python -m services.recorder.verifier``.

It compares a run with an earlier recording of it: a recorder whose messages are compared instead of
written. It acknowledges in place of sensors that the recording lacks, which physics would wait for.
"""

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
from .runner import NAME, BusRecorder


class _Topic:
    """A topic whose messages are compared."""

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
    expected
        topics that certainly have messages.
    """

    size_bytes = 0

    def __init__(
        self, recording: Recording, comparison: Comparison, expected: Collection[str]
    ) -> None:
        self._recording, self._comparison, self._expected = recording, comparison, expected
        # Earlier versions recorded fewer derived topics; ordered recordings lack diagnostics.
        made = made_topics(recording.run.scenario)
        self._ignored = {DIAGNOSTICS_TOPIC, *not_compared(recording), *made}
        self._topics: dict[str, _Topic | _Ignored] = {}
        self._has_begun = False

    def begin(self, epoch_nanos: int) -> "ReferenceComparison":
        """Start the comparison.

        Raises
        ------
        UserError
            when physics was restarted meanwhile.
        """
        if self._has_begun:
            raise UserError(
                "physics was restarted, so nothing was compared. Fix: run `groundlink verify` again"
            )
        self._has_begun = True
        return self

    def topic(self, name: str, ros_type: str, *, latched: bool = False) -> _Topic | _Ignored:
        """Return the topic of this name and type."""
        if name not in self._topics:
            if name in self._ignored:
                self._topics[name] = _Ignored()
            else:
                self._topics[name] = _Topic(self._comparison, name, ros_type)
                if name in self._expected:
                    self._comparison.declare(name, ros_type, name in self._recording.types)
        return self._topics[name]

    def commit(self, declared_hz: Mapping[str, float | None]) -> None:
        """Do nothing: there is no file."""

    def close(self) -> None:
        """Do nothing."""

    def tend(self, recorder: Recorder) -> None:
        """Do nothing."""

    def finish(self, recorder: Recorder) -> None:
        """Check that all messages were compared.

        Raises
        ------
        UserError
            when this process was too slow for the run.
        """
        if recorder.dropped:
            raise UserError(
                "messages arrived faster than they could be compared. Fix: reduce the load"
            )


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Compare until the run has reached the end of the recording, or `stop` is set."""
    parser = process.parser(NAME, "Compare a run with a recording of it, byte for byte.")
    parser.add_argument(
        "recording", type=Path, metavar="RUN.mcap", help="the recording to compare with"
    )
    parser.add_argument(
        "--verdict",
        type=Path,
        required=True,
        metavar="FILE.json",
        help="the file to write the verdict to",
    )
    options = parser.parse_args(arguments)
    with Recording(options.recording) as recording, Bus(connect=process.endpoint(options)) as bus:
        run, scenario = join(bus, options.run, stop)
        scenario = with_later_vehicles(recording, scenario)
        wanted = compared_span(recording)
        comparison = Comparison(compared_messages(recording), wanted, left_out(recording))
        duration = wanted.end_nanos - recording.run.epoch_nanos
        absent = {*silent_sensors(recording, scenario), *later_sensors(recording)}
        expected = {stream.topic for stream in outgoing(scenario, run)}
        reference = ReferenceComparison(recording, comparison, expected)
        BusRecorder(bus, scenario, run, reference, duration, absent=absent).record(stop)
        if not stop.is_set():
            options.verdict.write_bytes(msgspec.json.encode(comparison.verdicts()))


if __name__ == "__main__":
    process.run(NAME, main)
