# SPDX-License-Identifier: Apache-2.0
"""A recorded drive with other sensors is what a whole run with them gives."""

import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

from groundlink.recording.reader import Recording
from groundlink.ros.diagnostics import DIAGNOSTICS_TOPIC

from .rig import REPOSITORY

pytestmark = pytest.mark.system

CHANGES = ("--set", "scanner.dropout=0.2", "--set", "encoders.rate_hz=40.0")
"""Wheel odometry and `/tf` follow from the encoders."""


def groundlink(*words: str | Path) -> str:
    command = [sys.executable, "-m", "groundlink", *map(str, words)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return " ".join(done.stdout.split())


def messages(recording: Recording) -> dict[str, list[tuple[int, bytes]]]:
    found = defaultdict(list)
    for message in recording.read():
        found[message.topic].append((message.nanos, message.cdr))
    found.pop(DIAGNOSTICS_TOPIC, None)
    return found


def test_only_what_differs_is_simulated_and_equals_a_whole_run(tmp_path: Path) -> None:
    run, copy, again, whole = (tmp_path / f"{n}.mcap" for n in ("run", "copy", "again", "whole"))
    groundlink("record", "indoor_2d", "--duration", "1", "--out", run)
    assert "nothing differs" in groundlink("resim", run, "indoor_2d", "--out", copy)
    assert copy.read_bytes() == run.read_bytes()
    said = groundlink("resim", run, "indoor_2d", *CHANGES, "--out", again)
    assert "(rover/scanner, rover/encoders, rover/odometry)" in said
    groundlink("record", "indoor_2d", "--duration", "1", *CHANGES, "--out", whole)
    with Recording(run) as before, Recording(again) as resimulated, Recording(whole) as wanted:
        assert messages(resimulated) == messages(wanted)
        assert messages(resimulated) != messages(before)
        assert resimulated.types == wanted.types
        assert resimulated.run.scenario == wanted.run.scenario
        assert resimulated.end_nanos == wanted.end_nanos
        assert resimulated.journal == wanted.journal
