# SPDX-License-Identifier: Apache-2.0
"""What the C++ header reports and refuses, against the Python library."""

from __future__ import annotations

import struct
import subprocess
from pathlib import Path

import pytest

from tests.udp_bridge.reported import (
    WALL_NANOS,
    Arrival,
    Reported,
    by_python,
    controls,
    journey,
    told,
)

from .test_cpp import SANITIZERS, compiled

BUFFER = 1 << 30


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled("report", tmp_path_factory.mktemp("cpp"), *SANITIZERS)


def by_cpp(program: Path, arrivals: list[Arrival], folder: Path) -> Reported:
    file = folder / "arrivals.bin"
    rows = [struct.pack("<qBI", now, sender, len(d)) + d for now, sender, d in arrivals]
    file.write_bytes(b"".join(rows))
    command = [str(program), str(file), str(WALL_NANOS), str(BUFFER)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    found = Reported([], [])
    for line in done.stdout.splitlines():
        word, *rest = line.split()
        if word == "report":
            found.reports.append(told(int(rest[0]), bytes.fromhex(rest[1])))
        elif word == "refused":
            found.refused.append(rest[0])
    return found


@pytest.mark.parametrize("seed", range(12))
def test_what_became_of_messages_is_reported_as_python_reports_it(
    program: Path, tmp_path: Path, seed: int
) -> None:
    arrivals = journey(seed)
    ours, theirs = by_python(arrivals, BUFFER), by_cpp(program, arrivals, tmp_path)
    assert sorted(theirs.reports) == sorted(ours.reports)
    assert theirs.refused == ours.refused
    assert len({row[-1] for row in ours.reports}) > 10


def test_a_control_message_is_refused_for_the_same_reason(program: Path, tmp_path: Path) -> None:
    arrivals = controls()
    ours, theirs = by_python(arrivals, BUFFER), by_cpp(program, arrivals, tmp_path)
    assert theirs.refused == ours.refused
    assert 0 < len(ours.refused) < len(arrivals)
