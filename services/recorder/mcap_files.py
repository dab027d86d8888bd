# SPDX-License-Identifier: Apache-2.0
"""MCAP files of a run: the requested one, and another one for each further episode.

Existing files are never overwritten. The journal of the run is added in parts, so that the file of
a killed recorder has nearly all of it.
"""

import itertools
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.checkpoint import dumped as dump_checkpoint
from groundlink.episode.journal import Journal, dumped, loaded
from groundlink.messages.base import Clock
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.ros_channels import RosFile
from groundlink.scenario import Scenario
from groundlink.scene.loaded_world import in_present_world

from .recorder import Recorder, RecordingFile

NO_ENTRIES = 2**62
"""So many entries of a journal are left out where only its scenario is of interest."""

JOURNAL_NANOS = 2 * NANOS
"""Simulation time between two parts of the journal."""


class McapFiles:
    """Writes a run to MCAP files (a `RecordingFiles`).

    Parameters
    ----------
    ask
        queries physics for the journal, see `queries.journal_key`; returns b"" without an answer.
    """

    def __init__(
        self, path: Path, scenario: Scenario, run: str, ask: Callable[[str], bytes]
    ) -> None:
        self._wanted = path
        self._scenario = scenario
        self._run = run
        self._ask = ask
        self.path = path
        self._file: RosFile | None = None
        self._has_recorded = False
        self._entries = 0
        """Journal entries in the file."""

        self._checkpoints = 0
        """Checkpoints in the file."""

        self._next_journal_nanos = 0

    @property
    def has_begun(self) -> bool:
        """Whether a file is open."""
        return self._file is not None

    def begin(self, epoch_nanos: int) -> RecordingFile:
        """Open the next file, complete but without messages."""
        for number in itertools.count(1):
            if number > 1:
                self.path = self._wanted.with_stem(f"{self._wanted.stem}_{number}")
            try:
                file = RosFile(self.path)
                break
            except FileExistsError:
                continue
        if self.path != self._wanted:
            print(f"{self._wanted} exists; writing {self.path}", flush=True)
        if self._has_recorded:
            self._follow_world()
        self._has_recorded = True
        run = describe_run(self._scenario, self._run, epoch_nanos)
        file.mcap.add_metadata(RUN_RECORD, run_entries(run))
        self._file, self._entries, self._next_journal_nanos = file, 0, 0
        self._checkpoints = 0
        return file

    def _follow_world(self) -> None:
        """Take over the world of the present episode, which may have been loaded for it."""
        with suppress(UserError):  # physics is of another version, or does not answer
            journal = loaded(self._ask(f"/{NO_ENTRIES}"), "physics")
            self._scenario = in_present_world(self._scenario, journal.scenario)

    def tend(self, recorder: Recorder) -> None:
        """Commit the file; add the journal when it is due."""
        if recorder.clock and recorder.clock.stamp_nanos >= self._next_journal_nanos:
            self._next_journal_nanos = recorder.clock.stamp_nanos + JOURNAL_NANOS
            self._add_journal(recorder)
        recorder.commit()

    def finish(self, recorder: Recorder) -> None:
        """Complete the file, if one was begun."""
        if self._file is None:
            return
        self._add_journal(recorder)
        self._file.lacks(recorder.dropped)
        if recorder.is_whole and recorder.end_nanos is not None:
            self._file.end(recorder.end_nanos)
        recorder.commit(anyway=True)
        size = self._file.size_bytes / 1e6
        self._file.close()
        self._file = None
        print(f"wrote {self.path}: {recorder.counts['messages']} messages, {size:.1f} MB")

    def _add_journal(self, recorder: Recorder) -> None:
        """Add new journal entries of the episode to the file."""
        if self._file is None or recorder.clock is None:
            return
        journal = self._query(recorder.clock.episode, self._entries)
        if journal is not None:
            self._attach(recorder.clock.stamp_nanos, journal)
        self._add_checkpoints(self._new_checkpoints(recorder.clock), recorder.clock)

    def _new_checkpoints(self, clock: Clock) -> tuple[Checkpoint, ...]:
        """Return the checkpoints of the present episode that the file lacks."""
        if self._scenario.time.checkpoint_s is None:
            return ()
        with suppress(UserError):  # physics is of another version, or does not answer
            asked = f"{clock.episode}/{NO_ENTRIES}/{self._checkpoints}"
            return loaded(self._ask(asked), "physics").checkpoints or ()
        return ()

    def _add_checkpoints(self, checkpoints: Sequence[Checkpoint], clock: Clock) -> None:
        assert self._file is not None
        for checkpoint in checkpoints:
            nanos = clock.epoch_nanos + checkpoint.tick * TICK_NANOS
            # As that of the journal, the number of the episode would make equal files differ.
            self._file.add_checkpoint(nanos, dump_checkpoint(checkpoint.of_episode(0)))
        self._checkpoints += len(checkpoints)

    def _query(self, episode: int, left_out: int) -> Journal | None:
        """Return the journal of an episode without its first entries; None without an answer."""
        content = self._ask(f"{episode}/{left_out}")
        if not content:
            return None
        try:
            journal = loaded(content, "physics")
        except UserError:  # of another version
            return None
        return journal if (journal.episode, journal.left_out) == (episode, left_out) else None

    def _attach(self, nanos: int, journal: Journal) -> None:
        assert self._file is not None
        # The number of an episode comes from the wall clock: equal recordings would differ.
        self._file.add_journal(nanos, dumped(replace(journal, acks={}, episode=0)))
        self._entries += len(journal.entries)
