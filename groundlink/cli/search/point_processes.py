# SPDX-License-Identifier: Apache-2.0
"""Evaluates points of a journal, each by a process of its own, here or at workers elsewhere."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing.connection import wait
from pathlib import Path
from types import TracebackType

import msgspec

from groundlink.loader.overrides import FieldChange
from groundlink.monitor.supervisor import end_with_parent
from groundlink.search.point_journal import PointJournal, PointOutcome, PointRow, Values
from groundlink.search.point_leases import (
    EVALUATED_HERE,
    PointLeases,
    StartedPoint,
    WorkerOrders,
    WorkerReport,
)

from .evaluation import EvaluationRequest

RUNNING = "running"
"""Folder of the recordings of points that are evaluated now."""

SILENCE_SECONDS = 1.0
"""Interval at which silent workers are looked for."""


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
    say
        prints which workers come and go.
    """

    def __init__(
        self,
        journal: PointJournal,
        request: EvaluationRequest,
        changes: Callable[[Values], Sequence[FieldChange]],
        jobs: int,
        folder: Path,
        say: Callable[[str], object],
    ) -> None:
        self._journal, self._request, self._changes = journal, request, changes
        self._jobs, self._folder, self._say = jobs, folder / RUNNING, say
        self._running: dict[PointProcess, str] = {}
        """Keys of the points that are evaluated here."""

        self._lock = threading.Lock()  # guards what is below: workers report on another thread
        self._leases = PointLeases()
        self._finished: list[tuple[StartedPoint, PointOutcome]] = []
        self._wakes, self._wake = os.pipe()

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
        for end in (self._wakes, self._wake):
            os.close(end)

    def start(self, stage: str, number: int, values: Values) -> None:
        """Begin to evaluate a point, unless its outcome is known."""
        if self._journal.outcome(values) is None:
            with self._lock:
                self._leases.add(stage, number, values)
            self._fill()

    def result(self, values: Values) -> PointOutcome:
        """Wait for the outcome of a point that was started."""
        while (outcome := self._journal.outcome(values)) is None:
            outputs = [process.output for process in self._running]
            ready = wait([*outputs, self._wakes], SILENCE_SECONDS)
            if self._wakes in ready:
                os.read(self._wakes, 1)
            for process in [each for each in self._running if each.output in ready]:
                name = self._running.pop(process)
                self._finish(name, process.outcome())
                process.recording.unlink(missing_ok=True)
                self._write_finished()
            self._write_finished()
            self._fill()
        return outcome

    def exchange(self, report: WorkerReport) -> WorkerOrders:
        """Take a worker's outcomes and return the points that it begins; called on any thread."""
        search, determined_by = self._journal.identity, self._journal.determined_by
        is_mine = report.search == search
        for name, outcome in report.outcomes.items() if is_mine else ():
            self._finish(name, outcome)
        with self._lock:
            running = report.running if is_mine else []
            if self._leases.heard(report.worker, running, time.monotonic()):
                self._say(f"worker {report.worker} joined")
            points = self._leases.take(report.worker, report.free) if is_mine else {}
        requests = {name: self._request_of(point) for name, point in points.items()}
        start = {name: msgspec.json.encode(request) for name, request in requests.items()}
        return WorkerOrders(search, determined_by, start)

    def _finish(self, name: str, outcome: PointOutcome) -> None:
        """Keep the first outcome of a point for `result`."""
        with self._lock:
            if (point := self._leases.finish(name)) is not None:
                self._finished.append((point, outcome))
                os.write(self._wake, b"1")

    def _write_finished(self) -> None:
        with self._lock:
            finished, self._finished = self._finished, []
            for worker in self._leases.silent(time.monotonic()):
                self._say(f"worker {worker} left")
        for point, outcome in finished:
            self._journal.add(PointRow(point.stage, point.number, point.values, outcome))

    def _fill(self) -> None:
        with self._lock:
            points = self._leases.take(EVALUATED_HERE, self._jobs - len(self._running))
        for name, point in points.items():
            self._running[PointProcess(self._request_of(point))] = name

    def _request_of(self, point: StartedPoint) -> EvaluationRequest:
        return msgspec.structs.replace(
            self._request,
            recording=str(self._folder / f"{point.stage}_{point.number}.mcap"),
            changes=[(change.field, change.value) for change in self._changes(point.values)],
        )

    def _remove_recordings(self) -> None:
        shutil.rmtree(self._folder, ignore_errors=True)


class PointProcess:
    """A started evaluation: a process in a group of its own.

    Ctrl-C does not reach the group; the command kills it.
    """

    def __init__(self, request: EvaluationRequest) -> None:
        self.recording = Path(request.recording)
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
    process = PointProcess(request)
    try:
        return process.outcome()
    except BaseException:
        process.kill()
        raise
