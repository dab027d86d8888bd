# SPDX-License-Identifier: Apache-2.0
"""System tests of `groundlink snapshot`: four files per snapshot, one error line per mistake."""

import json
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from tests.services.sensors.rendering.opengl import _opengl as _opengl

from .rig import REPOSITORY

pytestmark = pytest.mark.system

SCENARIO = REPOSITORY / "scenarios" / "indoor_lab.yaml"


def snapshot(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "groundlink", "snapshot", str(SCENARIO), *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_a_snapshot_is_four_files_and_always_the_same(tmp_path: Path) -> None:
    taken = []
    for name in ("one", "two"):
        done = snapshot("rover/camera", "--at", "0.51", "--out", str(tmp_path / name))
        assert done.returncode == 0, done.stdout + done.stderr
        files = [Path(line) for line in done.stdout.splitlines()]
        assert [file.name for file in files] == [
            f"rover_camera_0.51s_{what}"
            for what in ("colour.png", "depth.png", "labels.png", "labels.json")
        ]
        taken.append([file.read_bytes() for file in files])
    assert taken[0] == taken[1]
    color = cv2.imread(str(files[0]))
    assert color is not None
    assert color.shape == (480, 640, 3)
    assert 60 < color.mean() < 200
    assert color.std() > 20
    things = json.loads(files[3].read_text(encoding="utf-8")).values()
    assert {"floor", "wall", "table", "pillar"} <= {thing["class"] for thing in things}


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("rover/camra",), "did you mean `rover/camera`?"),
        (("rover/lidar",), "no camera `rover/lidar`"),
        (("rover/camera", "--at", "-1"), "0 or more"),
    ],
)
def test_a_mistake_is_one_line(words: tuple[str, ...], said: str) -> None:
    done = snapshot(*words)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
