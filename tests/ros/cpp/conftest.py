# SPDX-License-Identifier: Apache-2.0
"""The node compiled twice, each time with another sanitizer, and the packages that it sees."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.udp_bridge.cpp.test_cpp import HEADER, STRICT, compiler

ROS = Path(__file__).resolve().parents[3] / "ros"
SOURCE = ROS / "udp_bridge_cpp/src/node.cpp"
INCLUDED = (ROS / "udp_bridge_cpp/include", HEADER, Path(__file__).with_name("stubs"))


def compiled(folder: Path, sanitizer: str) -> Path:
    """Return the node on stubs; -O0 halves the seconds of the compiler."""
    program = folder / "node"
    folders = [f"-I{path}" for path in INCLUDED]
    command = [compiler(), *STRICT, "-O0", f"-fsanitize={sanitizer}", *folders, str(SOURCE)]
    done = subprocess.run(
        [*command, "-pthread", "-o", str(program)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return program


@pytest.fixture(scope="session")
def memory_checked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("rclcpp-memory"), "address")


@pytest.fixture(scope="session")
def thread_checked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(tmp_path_factory.mktemp("rclcpp-threads"), "thread")


@pytest.fixture(scope="session")
def share(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the packages of ROS 2 and of this repository."""
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    folder = tmp_path_factory.mktemp("share")
    for package in (Path(sys.prefix) / "share").glob("*_msgs"):
        (folder / package.name).symlink_to(package)
    for name in ("groundlink_msgs", "tf2_msgs", "vision_msgs"):
        if not (folder / name).exists():
            (folder / name).symlink_to(ROS / name)
    return folder
