# SPDX-License-Identifier: Apache-2.0
"""The node in C++, as a user of ROS 1 has it: real topics, the same bytes, and Twists back."""

import itertools
import signal
import socket
import struct
import subprocess
from pathlib import Path

import pytest

from groundlink.recording.ros1 import to_ros1
from tests.ros.processes import Process
from tests.system.rig import wait_for
from tests.udp_bridge.cpp.test_cpp import HEADER, compiler
from tests.udp_bridge.vectors import load
from udp_bridge import MSG_TYPES, Header, Reassembler, parse
from udp_bridge.wire.control import CreditRequest, TopicReport
from udp_bridge.wire.typed import pack_typed

from .conftest import ROOT, Ros1

pytestmark = pytest.mark.system

SOURCE = ROOT / "ros/ros1/udp_bridge_roscpp/src/node.cpp"
CORE = ROOT / "ros/udp_bridge_cpp/include"
STRICT = ("-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", f"-I{HEADER}", f"-I{CORE}")
VECTORS = (
    *("imu", "laser-scan", "odometry", "cloud-shuffled", "compressed-image", "nav-sat-fix"),
    *("encoders", "range", "clock-shortest-header", "twist", "pose", "map", "image"),
    *("camera-info", "transforms", "joint-state", "twist-stamped", "text", "path"),
)
"""A vector of each type with a number."""
COLOR = "std_msgs/msg/ColorRGBA"
PATH = "{header: {frame_id: map}, poses: [{header: {frame_id: ab}, pose: {position: {x: 2.0}}}]}"

MOST_PUBLISHERS, MAX_SUBSCRIPTIONS = 256, 64


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("roscpp")
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
def test_a_node_in_cpp_publishes_the_same_bytes_and_sends_twists(ros1: Ros1, program: Path) -> None:
    vectors = {name: load(name) for name in VECTORS}
    meant = {name: vector.meaning["messages"][0] for name, vector in vectors.items()}
    renamed = {"twist": "/twist", "twist-stamped": "/twist_stamped"}  # /cmd_vel comes from ROS
    wire_topics = {name: renamed.get(name, message["topic"]) for name, message in meant.items()}
    topics = {
        name: topic or MSG_TYPES[meant[name]["msg_type"]].default_topic
        for name, topic in wire_topics.items()
    }
    numbers = itertools.count()
    ears = ros1.start(
        str(Path(__file__).with_name("bytes_listener.py")),
        *(*topics.values(), "/color", "/plan_back"),
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
                wanted = bytes(to_ros1(kind, whole.body)).hex()[8:]  # without header.seq

                # A message is lost where the subscriber isn't connected yet, so it is repeated.
                def arrives(
                    sent: str = wire_topics[name], topic: str = topics[name], wanted: str = wanted
                ) -> bool:
                    number = next(numbers)
                    for datagram in vector.datagrams:  # noqa: B023
                        header, at = parse(datagram)
                        again = (
                            header._replace(seq_number=number, topic=sent).pack() + datagram[at:]
                        )
                        ours.sendto(again, address)
                    return wanted in [text[8:] for _, text in ears.messages(topic)]

                wait_for(arrives, 20, name)
            color = b"\0\1\0\0" + struct.pack("<4f", 1, 2, 3, 4)
            unknown = Header(67, 0, 0, 1, 0, 0, "/thing").pack()
            ours.sendto(unknown + pack_typed("no_such_msgs/msg/Thing", color), address)

            def color_arrives() -> bool:
                body = pack_typed(COLOR, color)
                ours.sendto(Header(67, next(numbers), 0, 1, 9, 0, "/color").pack() + body, address)
                return color[4:].hex() in [text for _, text in ears.messages("/color")]

            wait_for(color_arrives, 20, COLOR)
            pub = ("/usr/bin/rostopic", "pub", "-r", "10", "/plan_back", "nav_msgs/Path", PATH)
            ros1.start(*pub)
            plan = Header(7, 0, 0, 1, 0, 0, "/plan_back").pack() + struct.pack(
                "<BBHf", 40, 1, 60, 0
            )
            ours.sendto(plan, address)
            driver = ros1.start(str(Path(__file__).with_name("driver.py")))
            request = Header(7, 0, 0, 1, 0, 0, "/cmd_vel").pack() + struct.pack("<BBHf", 9, 1, 5, 0)
            ours.sendto(request, address)
            ours.settimeout(20)
            reports: dict[str, tuple[int, int, int]] = {}
            twist, path = b"", b""

            def is_settled() -> bool:
                return len(reports) == len(meant) and not any(row[2] for row in reports.values())

            while not (twist and path and is_settled()):
                datagram = ours.recv(65536)
                header, at = parse(datagram)
                if header.msg_type == 9:
                    twist = datagram
                elif header.msg_type == 40:
                    path = datagram
                elif datagram[at] == 1:
                    report = TopicReport.parse(datagram[at:])
                    if header.topic in wire_topics.values() and report.msg_type != 7:
                        reports[header.topic] = report.published, report.dropped, report.pending
            header, at = parse(path)
            assert header.link == "map"
            heard = [text[8:] for _, text in ears.messages("/plan_back")]  # without header.seq
            assert bytes(to_ros1("nav_msgs/msg/Path", path[at:])).hex()[8:] in heard
            for topic in wire_topics.values():  # each was repeated until a subscriber had it
                assert reports[topic][0] >= 1
                assert reports[topic][1:] == (0, 0)
            header, at = parse(twist)
            assert header.topic == "/cmd_vel"
            assert twist[at:] == b"\0\1\0\0" + struct.pack("<6d", 0.5, 0, 0, 0, 0, 0)
            assert driver.end() is not None
            assert node.end(signal.SIGINT) == 0
            assert "dropped 1, refused 0" in node.output  # no_such_msgs
            assert node.output.count("no_such_msgs/msg/Thing can't be published") == 1
        finally:
            node.end()


def clock(topic: str) -> bytes:
    return Header(8, 0, 0, 1, 1, 0, topic).pack() + b"\0\1\0\0" + struct.pack("<iI", 1, 0)


def subscribe(topic: str, number: int) -> bytes:
    return Header(7, number, 0, 1, 0, 0, topic).pack() + struct.pack("<BBHf", 9, 1, 0, 0)


@pytest.mark.timeout(300)
def test_a_node_in_cpp_takes_its_peers_datagrams_alone_and_bounds_what_it_holds(
    ros1: Ros1, program: Path
) -> None:
    ask = Header(64, 0, 0, 1, 0, 0, "").pack() + CreditRequest().pack()
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ours,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        for end in (ours, stranger, other):
            end.bind(("127.0.0.1", 0))
        address = other.getsockname()
        other.close()
        peer = f"_peer:=127.0.0.1:{ours.getsockname()[1]}"
        options = [f"_bind:={address[0]}:{address[1]}", peer]
        node = Process(options, ros1.environment, python=str(program))
        try:
            node.wait_for("receiving at")
            ours.settimeout(60)

            def is_heard() -> None:
                ours.sendto(ask, address)
                while (datagram := ours.recv(65536))[parse(datagram)[1]] != 0:
                    pass  # a report

            stranger.sendto(ask, address)
            stranger.sendto(clock("/stranger"), address)
            for number in range(MOST_PUBLISHERS + 44):
                ours.sendto(clock(f"/t{number}"), address)
                if number % 50 == 0:
                    is_heard()  # the socket's buffer is not run over
            for number in range(MAX_SUBSCRIPTIONS + 6):
                ours.sendto(subscribe(f"/w{number}", 0), address)
            ours.sendto(subscribe("/not a name", 0), address)
            is_heard()
            assert node.end(signal.SIGINT) == 0
            stranger.setblocking(False)
            with pytest.raises(BlockingIOError):
                stranger.recv(65536)
        finally:
            node.end()
    assert f"published {MOST_PUBLISHERS}, " in node.output
    assert f"dropped {44 + 6 + 1}, refused 2" in node.output


def test_a_node_in_cpp_asks_for_its_peer_where_other_hosts_reach_it(
    ros1: Ros1, program: Path
) -> None:
    node = Process(["_bind:=0.0.0.0:0"], ros1.environment, python=str(program))
    assert node.exit_code() == 2
    assert "~peer" in node.output
