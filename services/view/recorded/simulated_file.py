# SPDX-License-Identifier: Apache-2.0
"""Sensors that are simulated on request into a file, which can be read while it grows."""

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from groundlink.core.errors import UserError
from groundlink.recording import metadata, repeated_run, resimulation
from groundlink.recording.reader import RecordedMessage, Recording
from groundlink.recording.resimulation import TopicPlan
from groundlink.recording.ros_channels import RosFile
from groundlink.scenario import Scenario

COMMITS = 50
"""Number of times that new messages become readable."""


class SimulatedFile:
    """A part of a resimulation, in a file of its own.

    Parameters
    ----------
    part
        sensors with their topics.
    folder
        folder of the file.
    say
        prints progress and errors; called on another thread.
    """

    def __init__(
        self,
        recording: Path,
        given: Scenario,
        part: TopicPlan,
        folder: Path,
        say: Callable[[str], object],
    ) -> None:
        self._recording, self._given, self._part, self._say = recording, given, part, say
        self.path = folder / f"{'+'.join(part.sensors).replace('/', '_')}.mcap"
        self.known_nanos = -1
        """All messages up to this stamp can be read."""

        self._writing = threading.Lock()  # a file cannot be opened while it gets a new end
        self._is_ended = self._has_failed = False
        self._thread: threading.Thread | None = None

    @property
    def topics(self) -> Sequence[str]:
        """Topics of the file."""
        return sorted(self._part.simulated)

    @property
    def is_begun(self) -> bool:
        """Whether the simulation was requested and has not failed."""
        return self._thread is not None and not self._has_failed

    def begin(self) -> None:
        """Begin to simulate, unless that was done."""
        if self._thread is None:
            self._thread = threading.Thread(target=self._simulate, daemon=True)
            self._thread.start()

    def end(self) -> None:
        """Stop simulating."""
        self._is_ended = True

    def opened(self) -> tuple[Recording, float]:
        """Return the file as it is now, and the stamp up to which all messages can be read."""
        with self._writing:
            return Recording(self.path), self.known_nanos

    def _simulate(self) -> None:
        names = ", ".join(self._part.sensors)
        try:
            with Recording(self._recording) as recording:
                self._write(recording, names)
        except UserError as error:
            self._has_failed = True
            self._say(f"cannot simulate {names}: {error}")

    def _write(self, recording: Recording, names: str) -> None:
        file = RosFile(self.path)
        first, end = recording.first_nanos, resimulation.end_nanos(recording)
        period = max((end - first) // COMMITS, 1)
        try:
            file.mcap.add_metadata(metadata.RUN_RECORD, metadata.run_entries(recording.run))
            due = first
            with repeated_run.simulated(recording, self._given, self._part) as messages:
                for message in messages:
                    if self._is_ended:
                        return
                    if message.nanos >= due:
                        self._commit(file, message.nanos - 1)
                        due = message.nanos + period
                        share = (message.nanos - first) / (end - first)
                        self._say(f"simulated {names}: {100 * share:.0f} %")
                    written = file.topic(message.topic, message.ros_type)
                    written.write(message.nanos, memoryview(message.cdr))
            self._commit(file, end)
            self._say(f"simulated {names}: 100 %")
        finally:
            file.close()

    def _commit(self, file: RosFile, known_nanos: int) -> None:
        with self._writing:
            file.commit({})
            self.known_nanos = known_nanos


class MessageWindows:
    """Messages of a file in windows of time, which usually follow each other.

    Parameters
    ----------
    opened
        opens the file, which may grow, as `SimulatedFile.opened`.
    topics
        topics to read.
    """

    def __init__(
        self, opened: Callable[[], tuple[Recording, float]], topics: Sequence[str]
    ) -> None:
        self._opened, self._topics = opened, topics
        self._file: Recording | None = None
        self._opened_nanos = self._until_nanos = -1.0
        self._next: RecordedMessage | None = None

    def between(self, after_nanos: int, until_nanos: int) -> list[RecordedMessage]:
        """Return the messages after an instant up to another one that is known."""
        if after_nanos != self._until_nanos or until_nanos > self._opened_nanos:
            self._open(after_nanos)
        found = []
        while self._next is not None and self._next.nanos <= until_nanos:
            found.append(self._next)
            self._next = next(self._messages, None)
        self._until_nanos = until_nanos
        return found

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()

    def _open(self, after_nanos: int) -> None:
        self.close()
        self._file, self._opened_nanos = self._opened()
        self._messages = self._file.read(self._topics, from_nanos=after_nanos + 1)
        self._next = next(self._messages, None)
