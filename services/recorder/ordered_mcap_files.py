# SPDX-License-Identifier: Apache-2.0
"""Reproducible MCAP files: the same run gives the same file, byte for byte.

Nothing in the file depends on when a message arrived. Messages are buffered until every sensor has
acknowledged a slice of simulation time. The slice is then sorted, written, and ends a chunk. The
journal is added at fixed simulation times, with every command at the tick from which it acts.
"""

import math
from collections.abc import Mapping

from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.episode.checkpoint import Checkpoint, period_ticks
from groundlink.episode.journal import Journal, acting_before
from groundlink.recording.ros_channels import RecordedTopic, RosFile

from .mcap_files import JOURNAL_NANOS, McapFiles
from .recorder import Recorder, RecordingFile

ASK_TIMES = 100
"""How often physics is asked for a checkpoint that it is about to complete."""

SLICE_NANOS = NANOS // 2
"""Simulation time of a slice: the most that a killed recorder loses, besides sensor latency."""

BufferedMessage = tuple[int, int, bytes]
"""Log time, number of the topic, CDR. Messages are written in this order."""


class _BufferedTopic:
    """A topic whose messages are buffered."""

    def __init__(self, number: int, topic: RecordedTopic, buffered: list[BufferedMessage]) -> None:
        self._number, self._buffered, self.topic = number, buffered, topic

    def write(self, nanos: int, cdr: memoryview) -> None:
        """Buffer a message."""
        self._buffered.append((nanos, self._number, bytes(cdr)))


class OrderedMcapFile:
    """A `RecordingFile` that sorts the messages that it buffers."""

    def __init__(self, file: RosFile) -> None:
        self._file = file
        self._buffered: list[BufferedMessage] = []
        self._topics: list[_BufferedTopic] = []
        self._by_name: dict[tuple[str, str], _BufferedTopic] = {}

    @property
    def size_bytes(self) -> int:
        """Size of the file on disk."""
        return self._file.size_bytes

    def topic(self, name: str, ros_type: str, *, latched: bool = False) -> _BufferedTopic:
        """Return the topic of this name and type; it is declared at the first call."""
        known = self._by_name.get((name, ros_type))
        if known is None:
            topic = self._file.topic(name, ros_type, latched=latched)
            known = _BufferedTopic(len(self._topics), topic, self._buffered)
            self._by_name[name, ros_type] = known
            self._topics.append(known)
        return known

    def write(self, until_nanos: float) -> None:
        """Write all buffered messages with an earlier log time, then end the chunk."""
        self._buffered.sort()
        count = 0
        for nanos, number, cdr in self._buffered:
            if nanos >= until_nanos:
                break
            self._topics[number].topic.write(nanos, memoryview(cdr))
            count += 1
        del self._buffered[:count]
        self._file.mcap.close_chunk()

    def commit(self, declared_hz: Mapping[str, float | None]) -> None:
        """Make the file complete with all messages written."""
        self._file.commit(declared_hz)

    def close(self) -> None:
        """Close the file in the state of the last commit."""
        self._file.close()


class OrderedMcapFiles(McapFiles):
    """MCAP files of runs that do not follow the wall clock (a `RecordingFiles`)."""

    _ordered: OrderedMcapFile
    _written_nanos = 0
    """All messages before this instant were written."""

    _waiting: tuple[bytes, ...] = ()
    """Journal entries that act after the messages written."""

    def begin(self, epoch_nanos: int) -> RecordingFile:
        """Open the next file."""
        super().begin(epoch_nanos)
        assert self._file is not None
        self._ordered = OrderedMcapFile(self._file)
        self._written_nanos, self._waiting = 0, ()
        return self._ordered

    def tend(self, recorder: Recorder) -> None:
        """Write complete slices."""
        before = self._written_nanos
        self._write_slices(recorder)
        recorder.commit(anyway=self._written_nanos != before)

    def finish(self, recorder: Recorder) -> None:
        """Write the remaining messages and complete the file, if one is open."""
        if self._file is not None and recorder.clock is not None:
            self._write_slices(recorder)
            if self._written_nanos != recorder.end_nanos:
                self._written_nanos = recorder.clock.stamp_nanos
                self._ordered.write(math.inf)
        super().finish(recorder)

    def _write_slices(self, recorder: Recorder) -> None:
        if self._file is None:
            return
        self._written_nanos = max(self._written_nanos, recorder.first_nanos)
        while self._written_nanos != recorder.end_nanos:
            until = self._written_nanos + SLICE_NANOS
            if recorder.end_nanos is not None:
                until = min(until, recorder.end_nanos)
            if not recorder.has_come(until):
                return
            self._ordered.write(until)
            self._written_nanos = until
            if until >= self._next_journal_nanos:
                self._next_journal_nanos = until + JOURNAL_NANOS
                self._add_journal(recorder)

    def _add_journal(self, recorder: Recorder) -> None:
        if recorder.clock is None:
            return
        journal = self._query(recorder.clock.episode, self._entries + len(self._waiting))
        if journal is None:
            return
        self._add_checkpoints(self._due_checkpoints(recorder, journal), recorder.clock)
        tick = (self._written_nanos - journal.epoch_nanos) // TICK_NANOS
        entries, self._waiting = acting_before(tick, (*self._waiting, *journal.entries))
        # How far physics is by now differs from run to run.
        part = replace(journal, tick=tick, digest="", entries=entries, left_out=self._entries)
        self._attach(self._written_nanos, part)

    def _due_checkpoints(self, recorder: Recorder, journal: Journal) -> list[Checkpoint]:
        """Return the checkpoints before the messages written, that every process has left behind.

        Physics may not yet have the acknowledgements that the recorder has. It takes what has come
        whenever it answers.
        """
        assert recorder.clock is not None
        scenario = self._scenario
        if scenario.time.checkpoint_s is None:
            return []
        tick = (self._written_nanos - journal.epoch_nanos) // TICK_NANOS - recorder.silent_ticks
        begins = journal.checkpoint.tick if journal.checkpoint else 0
        period = period_ticks(scenario.time.checkpoint_s)
        count = max(tick // period - begins // period, 0) - self._checkpoints
        for _ in range(ASK_TIMES if count > 0 else 0):
            if len(found := self._new_checkpoints(recorder.clock)) >= count:
                return list(found[:count])
        return []
