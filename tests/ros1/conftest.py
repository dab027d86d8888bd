# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 master that nobody else uses, and processes of ROS 1, by the Python that has it."""

import json
import os
import shutil
import socket
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.ros import cloud_digest
from tests.ros.conftest import ros as ros  # for tests with both
from tests.ros.processes import Process
from tests.system.rig import free_port, is_answered, wait_for

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
PYTHON = "/usr/bin/python3"
NEEDED = "import rospy, rosbag, roslaunch, genpy, tf2_ros, nav_msgs, std_srvs, diagnostic_msgs"


class Ros1:
    """One ROS 1 graph and the processes in it."""

    def __init__(self, folder: Path) -> None:
        self._processes: list[Process] = []
        port = free_port(socket.SOCK_STREAM)
        sources = (ROOT / "udp-bridge/src", ROOT / "ros/ros1/udp_bridge_ros1/src", folder)
        self.environment = {
            "PATH": "/usr/bin:/bin",
            "HOME": str(folder),
            "ROS_HOME": str(folder),
            "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
            "ROS_IP": "127.0.0.1",
            "PYTHONPATH": os.pathsep.join(map(str, sources)),
            "PYTHONUNBUFFERED": "1",
        }
        self.folder, self._port = folder, port

    def begin(self) -> None:
        """Build the messages and start what roscore starts first.

        Its node rosout and its slow end are no part of any test.
        """
        builder = self.start(str(ROOT / "ros/ros1/build_messages.py"), str(self.folder))
        assert builder.exit_code() == 0, builder.output
        shutil.copy(cloud_digest.__file__, self.folder)  # which the listener needs
        self.start("/usr/bin/rosmaster", "--core", "-p", str(self._port))
        wait_for(lambda: is_answered(("127.0.0.1", self._port)), 60, "a master")

    def start(self, *arguments: str) -> Process:
        process = Process(arguments, self.environment, python=PYTHON)
        self._processes.append(process)
        return process

    def bridge(self, bind: str) -> Process:
        node = self.start("-m", "udp_bridge_ros1", "--bind", bind)
        node.wait_for("receiving at")
        return node

    def listen(self, *rows: tuple[str, str], nap_s: float = 0.0) -> Process:
        """Start a subscriber, whose callbacks sleep once."""
        flat = [[*row, nap_s] for row in rows]
        return self.start(str(HERE / "listener.py"), json.dumps(flat))

    def end(self) -> None:
        with ExitStack() as all_of_them:  # the last one that began ends first
            for process in self._processes:
                all_of_them.callback(process.end)


@pytest.fixture
def ros1(tmp_path: Path) -> Iterator[Ros1]:
    if subprocess.run([PYTHON, "-c", NEEDED], check=False, capture_output=True).returncode:
        pytest.skip(f"no ROS 1 here: `{PYTHON} -c '{NEEDED}'` fails")
    running = Ros1(tmp_path)
    try:
        running.begin()
        yield running
    finally:
        running.end()
