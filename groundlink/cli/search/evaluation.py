# SPDX-License-Identifier: Apache-2.0
"""Evaluation of one point: record it, check it, compute its figures.

As a process, `python -m groundlink.cli.search.evaluation REQUEST`, it prints the outcome as a line
of JSON.
"""

import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec

from groundlink.cli.run.cases import check_recording, record_command
from groundlink.core.errors import UserError
from groundlink.loader.overrides import FieldChange
from groundlink.monitor.supervisor import end_with_parent
from groundlink.report.analysis.key_figures import key_figures_of
from groundlink.search.point_journal import PointOutcome, Verdict

ATTEMPTS = 2
"""Runs of a point without a result: another program may have taken the port of the first."""

HAS_RESULT = (0, 1)
"""Exit codes of `record` that judge a run; others mean that there was none."""


class EvaluationRequest(msgspec.Struct, frozen=True):
    """What to evaluate, and how."""

    scenario: str
    recording: str
    """New file; it is kept."""

    changes: list[tuple[str, Any]] = []
    """Changed fields with their values."""

    duration: str | None = None
    check: str | None = None
    objective: str | None = None
    """Name of a key figure, or a shell command that prints a number."""


def evaluated(request: EvaluationRequest) -> PointOutcome:
    """Run a point; return its outcome."""
    recording = Path(request.recording)
    for _ in range(ATTEMPTS):
        recording.unlink(missing_ok=True)
        code, text = _recorded(request, recording)
        if code in HAS_RESULT and recording.exists():
            break
    else:
        return PointOutcome("broken", text)
    try:
        figures = key_figures_of(recording)
    except UserError as error:
        return PointOutcome("broken", str(error))
    verdict: Verdict = "failed" if code else "passed"
    if request.check:
        line, check_code = check_recording(request.check, recording)
        if check_code or not code:
            text = line
        verdict = "failed" if code or check_code else "passed"
    objective = _objective(request.objective, figures, recording) if request.objective else None
    finite = {name: value for name, value in figures.items() if math.isfinite(value)}
    return PointOutcome(verdict, text, objective, finite)


def _recorded(request: EvaluationRequest, recording: Path) -> tuple[int, str]:
    """Record; return the exit code and what `record` says of the run."""
    case = tuple(FieldChange(*change) for change in request.changes)
    words = record_command(request.scenario, case, recording, request.duration)
    done = subprocess.run(
        [*words, "--json"],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=end_with_parent,
    )
    if done.returncode not in HAS_RESULT or not done.stdout:
        return done.returncode or 1, (done.stderr.strip().splitlines() or ["no result"])[-1]
    faults: list[str] = json.loads(done.stdout)["faults"]
    return done.returncode, faults[0] if faults else "-"


def _objective(objective: str, figures: dict[str, float], recording: Path) -> float | None:
    """Return the figure with this name, or the number that a command prints last."""
    if objective in figures:
        value = figures[objective]
    else:
        line, _ = check_recording(objective, recording)
        try:
            value = float(line.split()[0])
        except ValueError:
            return None
    return value if math.isfinite(value) else None


if __name__ == "__main__":
    outcome = evaluated(msgspec.json.decode(sys.argv[1], type=EvaluationRequest))
    print(msgspec.json.encode(outcome).decode(), flush=True)
