# SPDX-License-Identifier: Apache-2.0
"""Evaluations without runs: commands start these in place of processes."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from groundlink.cli.search import point_processes
from groundlink.cli.search.evaluation import EvaluationRequest
from groundlink.search.point_journal import PointOutcome

Model = Callable[[dict[str, Any]], PointOutcome]


class Evaluations:
    """What was evaluated, by a model of the outcome in place of a run."""

    def __init__(self) -> None:
        self.requests: list[EvaluationRequest] = []
        self.model: Model = lambda changes: PointOutcome("passed", "-")
        self.interrupt_at = 0
        """Number of the outcome in whose place Ctrl-C is pressed; 0: never."""

        self.outcomes = 0

    @property
    def changes(self) -> list[dict[str, Any]]:
        return [dict(request.changes) for request in self.requests]


@pytest.fixture
def evaluations(monkeypatch: pytest.MonkeyPatch) -> Iterator[Evaluations]:
    kept = Evaluations()
    opened: list[int] = []

    class Evaluation:
        def __init__(self, request: EvaluationRequest) -> None:
            kept.requests.append(request)
            self._request = request
            self.recording = Path(request.recording)
            # Ready at once, as a process that has printed its outcome.
            self.output, writes = os.pipe()
            os.close(writes)
            opened.append(self.output)

        def outcome(self) -> PointOutcome:
            kept.outcomes += 1
            if kept.outcomes == kept.interrupt_at:
                raise KeyboardInterrupt
            return kept.model(dict(self._request.changes))

        def kill(self) -> None:
            pass

    monkeypatch.setattr(point_processes, "PointProcess", Evaluation)
    yield kept
    for descriptor in opened:
        os.close(descriptor)
