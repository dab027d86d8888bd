# SPDX-License-Identifier: Apache-2.0
"""The build of message packages: nothing to do the second time, one line when it can't be done."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .bodies import ROS_FOLDER

pytest.importorskip("rclpy", reason="no ROS 2 here")


def build(ros_folder: Path, *folders: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ros_folder / "ros2" / "build_messages.py"), *folders],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )


@pytest.fixture
def changed_sources(tmp_path: Path) -> Path:
    folder = tmp_path / "ros"
    for name in ("tf2_msgs", "groundlink_msgs", "ros2"):
        shutil.copytree(ROS_FOLDER / name, folder / name)
    with (folder / "tf2_msgs" / "msg" / "TFMessage.msg").open("a") as definition:
        definition.write("int32 one_more\n")
    return folder


def test_up_to_date_build_is_unchanged() -> None:
    done = build(ROS_FOLDER, CC="no-such-compiler", CMAKE="no-such-cmake")
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split(" in ")[0] for line in lines] == [
        "tf2_msgs: up to date",
        "groundlink_msgs: up to date",
    ]


def test_missing_tools_are_all_named_in_one_line(changed_sources: Path) -> None:
    done = build(changed_sources, CXX="no-such-compiler", CMAKE="no-such-cmake")
    assert done.returncode == 2
    assert done.stderr == (
        "build_messages: missing on this machine: "
        "a C++ compiler (no-such-compiler), CMake 3.20 or newer (no-such-cmake)\n"
    )


def test_python_without_ros_gives_one_line(changed_sources: Path) -> None:
    script = changed_sources / "ros2" / "build_messages.py"
    done = subprocess.run(
        [sys.executable, "-S", "-I", str(script)],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("build_messages: these wheels are missing in ")
    assert done.stderr.count("\n") == 1


def test_folder_without_package_gives_one_line(tmp_path: Path) -> None:
    done = build(ROS_FOLDER, str(tmp_path))
    assert done.returncode == 2
    assert done.stderr == (
        f"build_messages: {tmp_path}/package.xml is no description of a package: "
        "No such file or directory\n"
    )


def test_required_package_is_named(tmp_path: Path) -> None:
    (tmp_path / "srv").mkdir()
    (tmp_path / "srv" / "Ask.srv").touch()
    package = (
        "<package><name>mine</name><depend>std_msgs</depend>"
        "<depend>their_msgs</depend><build_depend>more_msgs</build_depend></package>"
    )
    (tmp_path / "package.xml").write_text(package, encoding="utf-8")
    done = build(ROS_FOLDER, str(tmp_path))
    assert done.returncode == 2
    assert done.stderr.endswith(": ros-more-msgs, ros-their-msgs\n")
