# SPDX-License-Identifier: Apache-2.0
"""A recorded run gets the verdicts that it got live."""

from pathlib import Path
from typing import Any

import pytest

from groundlink.__main__ import main
from groundlink.core.clock import NANOS
from groundlink.data.dataset import Dataset
from groundlink.expectations.judge import ExpectationJudge
from groundlink.expectations.results import FAILED, PASSED
from groundlink.messages.base import Health, StreamReport
from groundlink.recording.judging import judged
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE, diagnostics
from groundlink.scenario import Scenario
from tests.groundlink.expectations.conftest import Expecting, drive, expecting
from tests.groundlink.expectations.drives import EPOCH, Sent, driven

__all__ = ["drive", "expecting"]

TOPICS = {
    "rover/vitals": "/vitals",
    "rover/command": "/cmd_vel",
    "rover/from_ros/pose": "/pose",
    "rover/ground_truth": "/ground_truth/odom",
}

EXPECTED: list[dict[str, Any]] = [
    {"kind": "reaches", "place": [-2, -4], "by_s": 7},
    {"kind": "never_touches"},
    {"kind": "never_fails"},
    {"kind": "stays_on_route", "within_m": 0.5},
    {"kind": "position_error", "topic": "/pose", "at_most_m": 0.1, "origin": "world"},
]

RATE: dict[str, Any] = {"kind": "rate", "topic": "/ground_truth/odom", "at_least_hz": 45}
AGE: dict[str, Any] = {"kind": "age", "topic": "/ground_truth/odom", "at_most_ms": 60}


def write(
    path: Path, scenario: Scenario, sent: list[Sent], reports: tuple[StreamReport, ...] = ()
) -> Path:
    """Write a recording, with a report of a gateway in the first second."""
    file = RosFile(path)
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, "lab", EPOCH)))
    for key, message in sent:
        stamp: int = message.stamp_nanos  # type: ignore[attr-defined]
        file.topic(TOPICS[key], CODECS[type(message)].ros_type).write(stamp, to_cdr(message))
    if reports:
        stamp = EPOCH + NANOS
        array = diagnostics(stamp, [Health("gateway", 1, 400, {}, reports)])
        file.topic(DIAGNOSTICS_TOPIC, DIAGNOSTICS_TYPE).write(stamp, array)
    file.commit({})
    file.close()
    return path


def test_verdicts_are_those_of_the_live_run(tmp_path: Path, expecting: Expecting) -> None:
    scenario, sent = expecting(*EXPECTED), driven(8, touched=["hall"])
    live = ExpectationJudge(scenario, "lab")
    for key, message in sent:
        live.take(f"groundlink/lab/{key}", message)
    live.finish()
    with Recording(write(tmp_path / "run.mcap", scenario, sent)) as recording:
        shares: list[float] = []
        assert judged(recording, recording.run.scenario, shares.append) == live.results()
    with Dataset(tmp_path / "run.mcap") as run:
        assert run.expectations() == live.results()
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert {one.verdict for one in live.results()} == {PASSED, FAILED}


@pytest.mark.parametrize(
    ("reports", "rate_hz", "skipped"),
    [
        ((), 50.0, True),
        ((StreamReport("/ground_truth/odom", "Odometry", 50.0, 40.0, 0.01, 9, 0),), 40.0, False),
        ((StreamReport("/odom", "Odometry", 50.0, 40.0, 0.01, 9, 0),), 50.0, False),
    ],
)
def test_figures_of_topics_are_those_of_ros_or_of_the_recording(
    tmp_path: Path,
    expecting: Expecting,
    reports: tuple[StreamReport, ...],
    rate_hz: float,
    skipped: bool,
) -> None:
    file = write(tmp_path / "run.mcap", expecting(RATE, AGE), driven(2), reports)
    with Recording(file) as recording:
        rate, age = judged(recording, recording.run.scenario)
    assert rate.value == pytest.approx(rate_hz)
    assert age.skipped == skipped


def test_the_command_ends_with_the_verdict(
    tmp_path: Path, expecting: Expecting, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write(tmp_path / "run.mcap", expecting(EXPECTED[0]), driven(8))
    assert main(["judge", str(file)]) == 0
    assert "1 of 1 expectations passed" in capsys.readouterr().out
    other = tmp_path / "other.yaml"
    other.write_text("expect: [{kind: reaches, place: [-2, -4], by_s: 3}]\n", encoding="utf-8")
    junit = tmp_path / "results.xml"
    assert main(["judge", str(file), str(other), "--json", "--junit", str(junit)]) == 1
    assert '"verdict": "failed"' in capsys.readouterr().out
    assert 'failures="1"' in junit.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("expect: [{kind: rate, topic: /odm, at_least_hz: 1}]", "did you mean `/odom`?"),
        ("expect: []", "no expectations"),
        ("name: lab", "`expect` is missing"),
    ],
)
def test_a_file_without_fitting_expectations_is_one_line(
    tmp_path: Path, expecting: Expecting, capsys: pytest.CaptureFixture[str], text: str, words: str
) -> None:
    file = write(tmp_path / "run.mcap", expecting(), driven(1))
    other = tmp_path / "other.yaml"
    other.write_text(text, encoding="utf-8")
    assert main(["judge", str(file), str(other)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line
