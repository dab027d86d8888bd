# SPDX-License-Identifier: Apache-2.0
"""A recording is shown whole, without a run."""

import re
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import rerun.blueprint as rrb

from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import (
    POINT,
    BusMessage,
    Clock,
    Imu,
    PointCloud,
    measured_nanos,
    packed,
)
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.ros_channels import RosFile
from groundlink.ros.cdr import CODECS, to_cdr
from services.view.__main__ import main
from services.view.layout import layout
from services.view.rerun_destinations import program
from services.view.viewer_subscriptions import streams_of

from .scenes import EPOCH, SCENARIO, truth

TICKS = 400
UPRIGHT, STILL = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)


def rows() -> list[tuple[str, BusMessage]]:
    records = np.zeros(7, POINT)
    records["x"], records["time"] = 2.0, np.linspace(0.0, 0.0999, 7)
    points = packed(records.view(np.uint8))
    found: list[tuple[str, BusMessage]] = []
    for tick in range(0, TICKS + 1, 8):
        stamp = EPOCH + tick * TICK_NANOS
        found.append(("/clock", Clock(stamp, EPOCH, tick, EPOCH)))
        found.append(("/imu", Imu(stamp, "imu_link", UPRIGHT, STILL, STILL, 0, 0, 0)))
        found.append(("/ground_truth/odom", truth(tick)))
        if tick % 40 == 0:
            found.append(("/points", PointCloud(stamp, "lidar_link", points)))
    return found


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    file = RosFile(path)
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(SCENARIO, "run", EPOCH)))
    for topic, message in rows():
        ros_type = CODECS[type(message)].ros_type
        file.topic(topic, ros_type).write(measured_nanos(message), to_cdr(message))
    file.commit({"/imu": 50.0})
    file.close()
    return path


def test_all_of_it_is_in_the_file_that_is_saved(recording: Path, tmp_path: Path) -> None:
    out = tmp_path / "run.rrd"
    main([str(recording), "--save", str(out)], threading.Event())
    held = subprocess.run(
        [program(), "rrd", "print", str(out)], check=True, capture_output=True, text=True
    ).stdout
    for entity, drawn in (
        (r"/rover/lidar", "Points3D"),
        (r"/tf/base_link", "Transform3D"),
        (r"/rover/links/base_link", "Mesh3D"),
        (r"/rover/path", "LineStrips3D"),
        (r"/rover/imu/acceleration", "Scalars"),
        (r"/world/", "Mesh3D"),
        (r"/run", "TextDocument"),
    ):
        assert re.search(rf"- {entity}\b.*{drawn}", held), entity
    rows = re.findall(r"with (\d+) rows .* - /rover/lidar - data columns.*Points3D", held)
    assert sum(map(int, rows)) == TICKS // 40  # and no more: the last is not over


def test_foxglove_is_not_asked_to_serve_a_file(recording: Path) -> None:
    with pytest.raises(UserError, match=r"Foxglove opens .*run.mcap itself"):
        main([str(recording), "--foxglove"], threading.Event())


def test_what_is_no_recording_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(UserError, match=r"none.mcap: no such file"):
        main([str(tmp_path / "none.mcap"), "--save", str(tmp_path / "a.rrd")], threading.Event())


@pytest.mark.parametrize("more", [["--run", "lab"], ["--connect", "tcp/127.0.0.1:1"]])
def test_a_file_is_of_no_bus(recording: Path, more: list[str]) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "groundlink", "view", str(recording), *more],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "--connect and --run do not apply to a recording" in done.stderr


def test_a_file_has_a_slider_and_no_link() -> None:
    def names(whole: bool) -> tuple[str, list[str]]:
        blueprint = layout(SCENARIO, streams_of(SCENARIO, "run"), whole=whole)
        found: list[str] = []

        def walk(part: rrb.Container | rrb.View) -> None:
            found.append(str(part.name))
            for each in getattr(part, "contents", []) if isinstance(part, rrb.Container) else []:
                walk(each)

        walk(blueprint.root_container)
        return str(blueprint.time_panel.state), found

    assert names(whole=True)[0] == "expanded"
    assert "Link" not in names(whole=True)[1]
    assert "Link" in names(whole=False)[1]
