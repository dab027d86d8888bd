# SPDX-License-Identifier: Apache-2.0
"""What the formats have in common, and the command that prints a calibration file."""

import json
import threading
from pathlib import Path
from typing import get_args

import pytest

from groundlink.core.errors import UserError
from groundlink.loader.scenario_files import SHIPPED
from services.sensors.lidar.native import FORMATS
from services.sensors.lidar.native.__main__ import main
from services.sensors.lidar.spec import Lidar


def test_a_scenario_can_name_each_format() -> None:
    assert set(get_args(Lidar.__annotations__["native_format"])) == FORMATS.keys()


def test_metadata_of_a_scenario_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    sheet = "datasheet: sensors/vlp16_paper.yaml, block_deg: 0,"
    assert sheet in text
    file = tmp_path / "own.yaml"
    file.write_text(text.replace(sheet, "datasheet: sensors/os1_64.yaml,"), encoding="utf-8")
    main([str(file), "rover/lidar"], threading.Event())
    metadata = json.loads(capsys.readouterr().out)
    assert metadata["config_params"]["udp_profile_lidar"] == "LEGACY"
    assert len(metadata["beam_intrinsics"]["beam_altitude_angles"]) == 64


@pytest.mark.parametrize(
    ("name", "reason"),
    [("rover/imu", "no LiDAR `rover/imu`"), ("rover/lidar", "not a VLP-16")],
)
def test_others_are_answered_in_one_line(name: str, reason: str) -> None:
    with pytest.raises(UserError, match=reason):
        main([str(SHIPPED / "indoor_lab.yaml"), name], threading.Event())
