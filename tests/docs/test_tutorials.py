# SPDX-License-Identifier: Apache-2.0
"""Each tutorial is followed from an empty folder, or from a clone, by its blocks alone.

Every page has a network and a shared memory of its own, so that ports and addresses are those of
the page.
"""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import groundlink
from experiments.estimation.environments import is_installed
from experiments.estimation.programs import EVO, KISS_ICP
from experiments.experiment import OUT
from experiments.studies.navigation import arrival, pose_errors, touched
from tests.ros_domains import next_domain
from tests.system.hosts import hosts

from .blocks import DOCS, ROOT, blocks
from .reader import Instead, Reader, commands

pytestmark = [pytest.mark.system, pytest.mark.timeout(200)]

TUTORIALS = DOCS / "tutorials"

CLONE = ("first-run", "your-own-sensor", "many-hosts", "navigate")
"""Pages that begin in a clone; all others begin in an empty folder."""

PROGRAMS = f"{OUT.resolve()}/environments/*/bin/{{kiss_icp_pipeline,evo_ape}}"
PIP = ".venv/bin/python -m pip install --quiet --no-deps --no-index --no-build-isolation"

INSTEAD = {
    "make setup": Instead("", "must not set up the environment of the tests again"),
    "make run DURATION=10": Instead("", "takes long; tests/system/test_main_job.py"),
    "make run": Instead(
        "make --old-file=.venv/.ready-run run", "must not set up the environment of the tests again"
    ),
    ".venv/bin/groundlink drive": Instead("", "reads keys; tests/system/test_driver.py"),
    ".venv/bin/groundlink view": Instead("", "opens a window; tests/system/test_view.py"),
    ".venv/bin/groundlink view run.mcap": Instead("", "opens a window; tests/system/test_view.py"),
    ".venv/bin/groundlink view compass.mcap": Instead(
        "", "opens a window; tests/system/test_foreign_sensor.py"
    ),
    'ros2 topic pub -r 20 -t 40 /cmd_vel geometry_msgs/msg/Twist "{linear: {x: 0.5}}"': Instead(
        "", "the ROS 2 of pip has no `ros2`; the next command does the same"
    ),
    ".venv/bin/pip install ./examples/magnetometer_sensor": Instead(
        f"{PIP} --target packages ./examples/magnetometer_sensor",
        "would change the environment of all tests",
    ),
    "python -m venv slam && slam/bin/pip install kiss-icp==1.3.0 evo==1.38.1 rosbags==0.11.9": (
        Instead(
            f"mkdir -p slam/bin && ln -s {PROGRAMS} slam/bin",
            "downloads; `make environments` has done it",
        )
    ),
    "docker compose -f main.yaml build": Instead("", "needs a Docker engine"),
    "GROUNDLINK_PUBLISH=0.0.0.0 docker compose -f main.yaml up --detach --wait": Instead(
        "", "needs a Docker engine"
    ),
    "docker compose -f main.yaml ps": Instead("", "needs a Docker engine"),
    ".venv/bin/groundlink top --once": Instead("", "needs the run of the containers"),
    "docker compose -f gpu.yaml up --detach --wait": Instead("", "needs a Docker engine"),
    "docker compose -f main.yaml -f secrets/compose.yaml up --detach --wait": Instead(
        "", "needs a Docker engine"
    ),
    "GROUNDLINK_CREDENTIALS=secrets/operator .venv/bin/groundlink pause": Instead(
        "", "needs the run of the containers; tests/system/test_secure.py"
    ),
    "docker compose -f main.yaml -f secrets/compose.yaml down": Instead(
        "", "needs a Docker engine"
    ),
}
"""The commands that are not run as printed: what is run instead, and why."""


def like_a_clone(folder: Path) -> None:
    """Fill a folder with links to the files of the repository; pip writes into `examples`."""
    for entry in ROOT.iterdir():
        if entry.name == "examples":
            shutil.copytree(entry, folder / entry.name)
        elif entry.name not in (".git", "build"):
            (folder / entry.name).symlink_to(entry)


def recorded_arrays(folder: Path) -> None:
    """A cloud in the world stands on the floor; the trajectory has all poses."""
    assert len((folder / "truth.tum").read_text().splitlines()) == 500
    cloud = np.load(folder / "cloud.npy")
    assert np.quantile(cloud[:, 2], 0.01) == pytest.approx(0, abs=0.1)
    assert np.all(np.ptp(cloud, axis=0) > 1)


def printed(folder: Path, terminal: str) -> list[str]:
    """Return the lines of the last command in a terminal."""
    *_, log = sorted(folder.parent.glob(f"* {terminal}.log"))
    return log.read_text(encoding="utf-8").splitlines()


def equal_drives(folder: Path) -> None:
    """In lockstep the node stops at the same place, to the last digit."""
    *_, last_but_one, last = printed(folder, "Second terminal")
    assert last == last_but_one


def repaired_scans(folder: Path) -> None:
    """Scans are repaired where the page says so; how many arrive depends on the machine."""
    report = json.loads((folder / "radio.json").read_text(encoding="utf-8"))
    repaired = {stream["topic"]: stream["repaired"] for stream in report["streams"]}
    assert repaired["/scan_repaired"] > 0
    assert not repaired["/scan"]


def driven_around_the_barrel(folder: Path) -> None:
    """The rover stands at both goals, touched nothing, and always knew where it was."""
    with groundlink.open(folder / "navigation.mcap") as dataset:
        truth = dataset.truth()
        begin_s = float(truth.seconds[0])
        for goal_m in ((0.0, -0.6), (-4.4, 0.1)):
            begin_s, _ = arrival(truth, begin_s, goal_m)
        assert touched(dataset) == []
        _, errors_m = pose_errors(dataset)
    assert len(errors_m) > 100
    assert errors_m.max() < 0.1
    assert 9.0 < truth.length_m < 11.5


AFTERWARDS: dict[str, Callable[[Path], None]] = {
    "drive-from-ros": equal_drives,
    "lossy-radio": repaired_scans,
    "navigate": driven_around_the_barrel,
    "record-and-read": recorded_arrays,
}
"""What is checked of the files and outputs that a page leaves; numbers are not compared."""

PAGES = sorted(page.stem for page in TUTORIALS.glob("*.md"))

EACH_DAY = ("first-run", "record-and-read")
"""Pages that `make test` follows. Other tests run each day what the other pages show."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[] if n in EACH_DAY else [pytest.mark.nightly]) for n in PAGES]
)
def test_a_tutorial_is_followed(name: str, tmp_path: Path) -> None:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    if name == "evaluate-slam" and not all(is_installed(p, OUT) for p in (KISS_ICP, EVO)):
        pytest.skip("kiss-icp and evo are not installed: make environments")
    folder = tmp_path / "folder"
    folder.mkdir()
    if name in CLONE:
        like_a_clone(folder)
    environment = {
        **os.environ,
        "COLUMNS": "120",
        "PATH": f"{ROOT}/.venv/bin:{os.environ['PATH']}",
        "PYTHONPATH": str(folder / "packages"),
        "PYTHONUNBUFFERED": "1",
        "ROS_DOMAIN_ID": next_domain(),
    }
    with hosts("here") as network:
        Reader(folder, environment, network.inside("here"), INSTEAD).follow(
            TUTORIALS / f"{name}.md"
        )
    AFTERWARDS.get(name, lambda folder: None)(folder)


def test_no_command_is_replaced_that_no_page_has() -> None:
    shown = {
        command
        for name in PAGES
        for block in blocks(TUTORIALS / f"{name}.md")
        if block.language == "sh"
        for command in commands(block)
    }
    assert INSTEAD.keys() - shown == set()
