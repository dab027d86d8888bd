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
from typing import Any, NamedTuple

import msgspec

from groundlink.cli.run.cases import check_recording, record_command
from groundlink.core.errors import UserError
from groundlink.expectations.results import PASSED
from groundlink.loader.overrides import FieldChange
from groundlink.monitor.supervisor import end_with_parent
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

    duration: str
    """Sim time, s."""

    changes: list[tuple[str, Any]] = []
    """Changed fields with their values."""

    check: str | None = None
    objective: str | None = None
    """Name of a key figure, or a shell command that prints a number."""

    over_link: bool = False
    """Whether the recording has what ROS receives over the emulated link."""

    only_check: bool = False
    """Whether the exit code of `record` does not count, which is 1 where a fault removes
    readings. Expectations of the scenario count."""


def evaluated(request: EvaluationRequest) -> PointOutcome:
    """Run a point; return its outcome."""
    # Not at the top: the command imports this module before it has checked its extra.
    from groundlink.report.analysis.key_figures import key_figures_of

    recording = Path(request.recording)
    for _ in range(ATTEMPTS):
        recording.unlink(missing_ok=True)
        run = _recorded(request, recording)
        if run.code in HAS_RESULT and recording.exists():
            break
    else:
        return PointOutcome("broken", run.text)
    try:
        figures = key_figures_of(recording)
    except UserError as error:
        return PointOutcome("broken", str(error))
    code, text = run.code, run.text
    if request.only_check:
        code = 1 if run.fails_expectation else 0
    if request.check:
        line, check_code = check_recording(request.check, recording)
        if check_code or not code:
            code, text = check_code, line
    verdict: Verdict = "failed" if code else "passed"
    objective = _objective(request.objective, figures, recording) if request.objective else None
    finite = {name: value for name, value in figures.items() if math.isfinite(value)}
    return PointOutcome(verdict, text, objective, finite)


class _Recorded(NamedTuple):
    """What `record` says of a run."""

    code: int
    text: str
    fails_expectation: bool = False


def _recorded(request: EvaluationRequest, recording: Path) -> _Recorded:
    """Record a run."""
    case = tuple(FieldChange(*change) for change in request.changes)
    words = record_command(
        request.scenario, case, recording, request.duration, over_link=request.over_link
    )
    done = subprocess.run(
        [*words, "--json"],
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=end_with_parent,
    )
    if done.returncode not in HAS_RESULT or not done.stdout:
        lines = done.stderr.strip().splitlines() or ["no result"]
        return _Recorded(done.returncode or UserError.exit_code, lines[-1])
    printed: dict[str, Any] = json.loads(done.stdout)
    expectations = printed.get("expectations", ())
    failed = [
        each["text"] for each in expectations if each["verdict"] != PASSED and not each["skipped"]
    ]
    text = next(iter([*failed, *printed["faults"]]), "-")
    return _Recorded(done.returncode, text, bool(failed))


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
