# SPDX-License-Identifier: Apache-2.0
"""Evaluates points of a journal, each by a process of its own, several at a time."""

import os
import shutil
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import wait
from pathlib import Path
from types import TracebackType

import msgspec

from groundlink.loader.overrides import FieldChange
from groundlink.monitor.supervisor import end_with_parent
from groundlink.search.point_journal import PointJournal, PointOutcome, PointRow, Values

from .evaluation import EvaluationRequest

RUNNING = "running"
"""Folder of the recordings of points that are evaluated now."""


_Started = tuple[str, int, Values]
"""Stage, number and values of a point."""


class PointProcesses:
    """Evaluates the points that a journal does not have, and adds them to it.

    As a context it ends all processes at its end.

    Parameters
    ----------
    journal
        known points.
    request
        scenario, check and so on; the changes and the recording are those of a point.
    changes
        returns the changed fields of a point.
    jobs
        processes at a time.
    folder
        folder of the search.
    """

    def __init__(
        self,
        journal: PointJournal,
        request: EvaluationRequest,
        changes: Callable[[Values], Sequence[FieldChange]],
        jobs: int,
        folder: Path,
    ) -> None:
        self._journal, self._request, self._changes = journal, request, changes
        self._jobs, self._folder = jobs, folder / RUNNING
        self._waiting: deque[_Started] = deque()
        self._running: dict[_PointProcess, _Started] = {}

    def __enter__(self) -> "PointProcesses":
        self._remove_recordings()
        self._folder.mkdir()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for process in self._running:
            process.kill()
        self._remove_recordings()

    def start(self, stage: str, number: int, values: Values) -> None:
        """Begin to evaluate a point, unless its outcome is known."""
        if self._journal.outcome(values) is None:
            self._waiting.append((stage, number, values))
            self._fill()

    def result(self, values: Values) -> PointOutcome:
        """Wait for the outcome of a point that was started."""
        while (outcome := self._journal.outcome(values)) is None:
            ready = wait([process.output for process in self._running])
            for process in [each for each in self._running if each.output in ready]:
                stage, number, known = self._running.pop(process)
                self._journal.add(PointRow(stage, number, dict(known), process.outcome()))
                self._recording(stage, number).unlink(missing_ok=True)
            self._fill()
        return outcome

    def _fill(self) -> None:
        while self._waiting and len(self._running) < self._jobs:
            stage, number, values = started = self._waiting.popleft()
            request = msgspec.structs.replace(
                self._request,
                recording=str(self._recording(stage, number)),
                changes=[(change.field, change.value) for change in self._changes(values)],
            )
            self._running[_PointProcess(request)] = started

    def _recording(self, stage: str, number: int) -> Path:
        return self._folder / f"{stage}_{number}.mcap"

    def _remove_recordings(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)


class _PointProcess:
    """A started evaluation: a process in a group of its own.

    Ctrl-C does not reach the group; the command kills it.
    """

    def __init__(self, request: EvaluationRequest) -> None:
        words = [sys.executable, "-m", "groundlink.cli.search.evaluation"]
        self._process = subprocess.Popen(
            [*words, msgspec.json.encode(request).decode()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=end_with_parent,
        )
        assert self._process.stdout is not None
        self.output = self._process.stdout.fileno()

    def outcome(self) -> PointOutcome:
        """Wait for its end; return the outcome."""
        printed, _ = self._process.communicate()
        if self._process.returncode or not printed:
            ended = f"the evaluation ended with exit code {self._process.returncode}"
            return PointOutcome("broken", ended)
        return msgspec.json.decode(printed.splitlines()[-1], type=PointOutcome)

    def kill(self) -> None:
        """End it with all processes that it started."""
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()


def evaluate_alone(request: EvaluationRequest) -> PointOutcome:
    """Evaluate a point outside of a journal; its recording is kept."""
    process = _PointProcess(request)
    try:
        return process.outcome()
    except BaseException:
        process.kill()
        raise
