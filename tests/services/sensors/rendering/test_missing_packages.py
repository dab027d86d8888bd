# SPDX-License-Identifier: Apache-2.0
"""A camera's process without a package that cameras need: one line and exit code 3."""

import subprocess
import sys

import pytest

WITHOUT = """
import runpy, sys
module, package, sys.argv[1:] = sys.argv[1], sys.argv[2], sys.argv[3:]
sys.modules[package] = None  # as if it were not installed

from groundlink.core.extras import needs
from groundlink.process import runner
from groundlink.scenario.sensor_kinds import load_reference
from services.sensors.runtime import process

def make(kind):
    with needs(kind.extra):
        load_reference(kind.model)(None, None, None)

def run(kind):  # the process without a run to join
    runner.run(module, lambda *_: make(kind))

process.run = run
runpy.run_module(module, run_name="__main__")
"""


@pytest.mark.parametrize(
    ("kind", "package"),
    [
        ("camera", "moderngl"),
        ("camera", "cv2"),
        ("stereo_camera", "moderngl"),
        ("stereo_camera", "cv2"),
        ("depth_camera", "cv2"),
        ("rendering", "moderngl"),
        ("rendering", "cv2"),
    ],
)
def test_a_missing_package_is_one_line(kind: str, package: str) -> None:
    words = [f"services.sensors.{kind}", package]
    if kind == "rendering":
        words += ["--name", "rover/camera", "--at", "0", "--out", "."]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT, *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.stderr.count("\n") == 1, done.stderr
    assert f"the Python package `{package}` is not installed" in done.stderr
    assert "pip install 'groundlink[camera]'" in done.stderr
    assert done.returncode == 3
