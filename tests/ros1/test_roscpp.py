# SPDX-License-Identifier: Apache-2.0
"""The node in C++, as a user of ROS 1 has it: real topics, the same bytes, and Twists back."""

from __future__ import annotations

import itertools
import signal
import socket
import struct
import subprocess
from pathlib import Path

import pytest

from groundlink.recording.ros1 import body
from tests.ros.processes import Process
from tests.system.rig import wait_for
from tests.udp_bridge.cpp.test_cpp import HEADER, compiler
from tests.udp_bridge.vectors import load
from udp_bridge import MSG_TYPES, Header, Reassembler, parse

from .conftest import ROOT, Ros1

pytestmark = pytest.mark.system

SOURCE = ROOT / "ros/ros1/udp_bridge_roscpp/src/node.cpp"
STRICT = ("-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", f"-I{HEADER}")
VECTORS = ("imu", "laser-scan", "odometry", "cloud-shuffled")


def built(folder: Path) -> Path:
    asked = ["pkg-config", "--cflags", "--libs", "roscpp", "nav_msgs", "sensor_msgs"]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    if found.returncode:
        pytest.skip("no roscpp here")
    flags = found.stdout.split()
    program = folder / "node"
    command = [compiler(), *STRICT, str(SOURCE), "-o", str(program), *flags]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return program


@pytest.mark.timeout(300)  # roscpp takes a compiler long
def test_a_node_in_cpp_publishes_the_same_bytes_and_sends_twists(
    ros1: Ros1, tmp_path: Path
) -> None:
    vectors = {name: load(name) for name in VECTORS}
    meant = {name: vector.meaning["messages"][0] for name, vector in vectors.items()}
    program = built(tmp_path)
    numbers = itertools.count()
    ears = ros1.start(
        str(Path(__file__).with_name("bytes_listener.py")),
        *(message["topic"] for message in meant.values()),
    )
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours:
        ours.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 0))
            address = other.getsockname()
        bind = f"_bind:={address[0]}:{address[1]}"
        node = Process([bind], ros1.environment, python=str(program))
        try:
            node.wait_for("receiving at")
            for name, vector in vectors.items():
                reassembler = Reassembler()
                whole = [reassembler.receive(d, "", 0) for d in vector.datagrams][-1]
                assert whole is not None
                kind = str(MSG_TYPES[whole.msg_type].ros_type)
                wanted = bytes(body(kind, whole.body)).hex()[8:]  # without header.seq

                # A message is lost where the subscriber isn't connected yet, so it is repeated.
                def arrives(topic: str = whole.topic, wanted: str = wanted) -> bool:
                    number = next(numbers)
                    for datagram in vector.datagrams:  # noqa: B023
                        header, at = parse(datagram)
                        again = header._replace(seq_number=number).pack() + datagram[at:]
                        ours.sendto(again, address)
                    return wanted in [text[8:] for _, text in ears.messages(topic)]

                wait_for(arrives, 20, name)
            driver = ros1.start(str(Path(__file__).with_name("driver.py")))
            wish = Header(7, 0, 0, 1, 0, 0, "/cmd_vel").pack() + struct.pack("<BBHf", 9, 1, 5, 0)
            ours.sendto(wish, address)
            ours.settimeout(20)
            while (datagram := ours.recv(65536))[0] != 9:
                pass
            header, at = parse(datagram)
            assert header.topic == "/cmd_vel"
            assert datagram[at:] == b"\0\1\0\0" + struct.pack("<6d", 0.5, 0, 0, 0, 0, 0)
            assert driver.end() is not None
            assert node.end(signal.SIGINT) == 0
            assert "dropped 0, refused 0" in node.output
        finally:
            node.end()
