# SPDX-License-Identifier: Apache-2.0
"""A point's verdict follows from the exit codes of `record` and of the check."""

import json
import shlex
import sys
from pathlib import Path

import pytest

from groundlink.cli.search import evaluation
from groundlink.cli.search.evaluation import EvaluationRequest, evaluated

ROOT = Path(__file__).parents[4]
RECORDING = ROOT / "tests" / "compatibility" / "every_kind.mcap"


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A file that counts runs; `record` is replaced by a shell script from the scenario's name."""
    runs = tmp_path / "runs"

    def record_command(
        scenario: str, case: object, recording: Path, duration: str, *, over_link: bool
    ) -> list[str]:
        late, close, silent = (
            f"echo '{json.dumps({'faults': ['late'], 'expectations': expectations})}'"
            for expectations in ([], EXPECTED, NOTHING)
        )
        script = scenario.format(
            copy=f"cp {RECORDING} {recording}", faults=late, expected=close, nothing=silent
        )
        return ["sh", "-c", f"echo >> {runs}; {script}", "sh"]

    monkeypatch.setattr(evaluation, "record_command", record_command)
    return runs


GOOD = "{copy}; echo '{{\"faults\": []}}'"
LATE = "{copy}; {faults}; exit 1"
EXPECTED = [
    {"verdict": "passed", "text": "arrived", "skipped": False},
    {"verdict": "undecided", "text": "no rain", "skipped": True},
    {"verdict": "failed", "text": "too close", "skipped": False},
]
CLOSE = "{copy}; {expected}; exit 1"
NOTHING = [{"verdict": "undecided", "text": "no message came", "skipped": False}]
SILENT = "{copy}; {nothing}; exit 1"


@pytest.mark.parametrize(
    ("scenario", "check", "only_check", "expected"),
    [
        (GOOD, None, False, ("passed", "-")),
        (GOOD, "echo 3 m; true", False, ("passed", "3 m")),
        (GOOD, "echo 9 m; false", False, ("failed", "9 m")),
        (LATE, None, False, ("failed", "late")),
        (LATE, "echo 3 m; true", False, ("failed", "late")),
        (LATE, "echo 9 m; false", False, ("failed", "9 m")),
        (LATE, "echo 3 m; true", True, ("passed", "3 m")),
        (CLOSE, None, False, ("failed", "too close")),
        (CLOSE, "echo 3 m; true", True, ("failed", "too close")),
        (SILENT, "echo 3 m; true", True, ("failed", "no message came")),
        ("echo no >&2; echo room >&2; exit 2", "true", False, ("broken", "room")),
        ("exit 0", "true", False, ("broken", "no result")),
    ],
)
def test_verdict(
    scenario: str,
    check: str | None,
    only_check: bool,
    expected: tuple[str, str],
    recorded: Path,
    tmp_path: Path,
) -> None:
    outcome = evaluated(
        EvaluationRequest(
            scenario, str(tmp_path / "a.mcap"), "3", check=check, only_check=only_check
        )
    )
    assert (outcome.verdict, outcome.text) == expected
    is_broken = outcome.verdict == "broken"
    assert len(recorded.read_text().splitlines()) == 1 + is_broken, "only these are run again"
    assert bool(outcome.figures) is not is_broken


@pytest.mark.parametrize(
    ("objective", "expected"),
    [
        ("echo 2.5 m; true", 2.5),
        ("echo nothing; true", None),
        ("echo nan; true", None),
        ("true", None),
    ],
)
def test_objective_of_a_command(
    objective: str, expected: float | None, recorded: Path, tmp_path: Path
) -> None:
    request = EvaluationRequest(GOOD, str(tmp_path / "a.mcap"), "3", objective=objective)
    assert evaluated(request).objective == expected


def test_objective_is_a_figure_of_the_recording(recorded: Path, tmp_path: Path) -> None:
    request = EvaluationRequest(GOOD, str(tmp_path / "a.mcap"), "3", objective="driven m")
    outcome = evaluated(request)
    assert outcome.objective == outcome.figures["driven m"] > 0


def test_check_gets_the_recording_as_its_last_argument(recorded: Path, tmp_path: Path) -> None:
    program = tmp_path / "check.py"
    program.write_text("import sys\nprint(sys.argv[1:])\n")
    check = shlex.join([sys.executable, str(program), "first"])
    request = EvaluationRequest(GOOD, str(tmp_path / "a.mcap"), "3", check=check)
    assert evaluated(request).text == str(["first", str(tmp_path / "a.mcap")])
