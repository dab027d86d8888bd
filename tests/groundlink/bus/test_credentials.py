# SPDX-License-Identifier: Apache-2.0
"""Folders of credentials."""

import datetime
import json
from pathlib import Path

import pytest

from groundlink.bus import credentials
from groundlink.bus.credentials import ABOUT, AUTHORITY, CERTIFICATE, KEY, VARIABLE, about_text
from groundlink.core.errors import UserError
from groundlink.deploy.certificates import Authority
from tests.groundlink.test_certified_bus import write

NOW = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write(tmp_path / "imu", Authority(NOW), "rover/imu")
    return tmp_path / "imu"


def test_without_the_variable_there_are_none() -> None:
    assert credentials.from_environment({}) is None


def test_both_ends_show_their_certificate(folder: Path) -> None:
    found = credentials.from_environment({VARIABLE: str(folder)})
    assert found is not None
    tls = found.settings()["transport/link/tls"]
    assert tls["enable_mtls"]
    assert tls["verify_name_on_connect"]
    assert tls["connect_private_key"] == str(folder / KEY)
    assert "access_control" not in found.settings()


def test_a_routers_folder_holds_its_rules(folder: Path) -> None:
    (folder / ABOUT).write_text(about_text("router", {"enabled": True}))
    assert credentials.Credentials(folder).settings()["access_control"] == {"enabled": True}


def test_another_processs_folder_is_refused(folder: Path) -> None:
    found = credentials.Credentials(folder)
    found.check("rover/imu")
    with pytest.raises(UserError, match=r"expected `rover/lidar`, got `rover/imu`"):
        found.check("rover/lidar")


@pytest.mark.parametrize("name", [AUTHORITY, CERTIFICATE, KEY, ABOUT])
def test_incomplete_folder_names_missing_files(folder: Path, name: str) -> None:
    (folder / name).unlink()
    with pytest.raises(UserError, match=f"{name}.*groundlink secure"):
        credentials.Credentials(folder)


def test_a_broken_file_is_one_line(folder: Path) -> None:
    (folder / ABOUT).write_text(json.dumps({"process": 3}))
    with pytest.raises(UserError, match=r"about\.json: .*str"):
        credentials.Credentials(folder)
