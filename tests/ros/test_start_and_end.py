# SPDX-License-Identifier: Apache-2.0
"""Users' mistakes are one line and exit code 2; signals end the node at once, with a summary."""

import signal
import socket

import pytest

from .conftest import Ros


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--bind", "here"], "bind is 'here'; expected HOST:PORT such as 127.0.0.1:7511"),
        (["--bind", "127.0.0.1:65536"], "bind is '127.0.0.1:65536'; expected HOST:PORT"),
        (["--ros-args", "-p", "peer:=x:y"], "peer is 'x:y'; expected HOST:PORT"),
        (["--ros-args", "-p", "bind:=7511"], "'bind'"),
        (["--bind", "0.0.0.0:0"], "bind 0.0.0.0:0: other hosts can reach this socket; expected"),
        (["--ros-args", "-p", "allow_any_peer:=7"], "allow_any_peer is '7'; expected true or f"),
    ],
)
def test_bad_addresses(ros: Ros, arguments: list[str], complaint: str) -> None:
    process = ros.start("-m", "udp_bridge_ros2", *arguments)
    assert process.exit_code() == 2
    assert len(process.lines) == 1
    assert process.output.startswith("udp_bridge_ros2: ")
    assert complaint in process.output


@pytest.mark.parametrize(
    "arguments",
    [
        ["--allow-any-peer"],
        ["--peer", "127.0.0.1:0"],
        ["--ros-args", "-p", "allow_any_peer:=true"],
    ],
)
def test_a_port_that_others_reach_is_opened_for_whom_the_user_names(
    ros: Ros, arguments: list[str]
) -> None:
    process = ros.start("-m", "udp_bridge_ros2", "--bind", "0.0.0.0:0", *arguments)
    process.wait_for("receiving at 0.0.0.0:")
    assert process.end(signal.SIGTERM, timeout_s=5.0) == 0


def test_a_port_in_use(ros: Ros) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        process = ros.start("-m", "udp_bridge_ros2", "--ros-args", "-p", f"bind:={address}")
        assert process.exit_code() == 2
    assert process.lines == [f"udp_bridge_ros2: can't bind to {address}: Address already in use"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_a_summary(ros: Ros, number: signal.Signals) -> None:
    process, _ = ros.bridge()
    assert process.end(number, timeout_s=2.0) == 0
    assert len(process.lines) == 3
    assert "discovery LOCALHOST, Fast DDS profile" in process.lines[0]
    assert "services of std_srvs at /udp_bridge/: state, pause, resume," in process.lines[1]
    assert "0 messages published on 0 topics" in process.lines[2]
