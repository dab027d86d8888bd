# SPDX-License-Identifier: Apache-2.0
"""Fixtures of the ROS tests: a private domain, the node, its users, and the bridge's far end."""

import json
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.ros_domains import next_domain
from udp_bridge import Link, Message

from .processes import Process
from .waiting import wait_until

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
DEPTH = 1000
"""What a listener's DDS keeps: a busy machine may delay it, and that is not what is tested."""
SENSOR_DATA = ("BEST_EFFORT", "VOLATILE", DEPTH, 0.0)
RELIABLE = ("RELIABLE", "VOLATILE", DEPTH, 0.0)
LATCHED = ("RELIABLE", "TRANSIENT_LOCAL", DEPTH, 0.0)
LISTENED = tuple[str, str, tuple[str, str, int, float]]
"""A ROS type, a topic, and how it is subscribed to."""


class Ros:
    """One ROS domain that nobody else uses, and the processes in it."""

    def __init__(self) -> None:
        paths = [ROOT / "udp-bridge" / "src", ROOT / "ros" / "ros2" / "udp_bridge_ros2"]
        # What the node and its users need to be told has to work on its own, so nothing of DDS
        # that is set outside comes along.
        kept = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("ROS_", "RMW_", "FASTDDS_", "FASTRTPS_"))
        }
        self.environment = kept | {
            "ROS_DOMAIN_ID": next_domain(),
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "PYTHONUNBUFFERED": "1",
        }
        self._processes: list[Process] = []

    def start(self, *arguments: str, **environment: str) -> Process:
        process = Process(arguments, self.environment | environment)
        self._processes.append(process)
        return process

    def bridge(self, *arguments: str) -> tuple[Process, tuple[str, int]]:
        """Start the node; return it and where it receives."""
        process = self.start("-m", "udp_bridge_ros2", "--bind", "127.0.0.1:0", *arguments)
        match = process.wait_for(r"receiving at ([\d.]+):(\d+);")
        return process, (match[1], int(match[2]))

    def listen(self, *rows: LISTENED) -> Process:
        """Start a subscriber, without the bridge's DDS settings, and wait until it is ready."""
        flat = [[ros_type, topic, *how] for ros_type, topic, how in rows]
        process = self.start(str(HERE / "listener.py"), json.dumps(flat))
        process.wait_for("ready")
        return process

    def talk(self, ros_type: str, topic: str, rate_hz: float) -> Process:
        """Start a publisher of numbered messages."""
        return self.start(str(HERE / "talker.py"), ros_type, topic, str(rate_hz))

    def end(self) -> None:
        with ExitStack() as all_of_them:  # one that does not end keeps none of the others
            for process in self._processes:
                all_of_them.callback(process.end)


class FarEnd:
    """The bridge's other end, as the gateway is one: sends, and keeps what comes back."""

    def __init__(self, to: tuple[str, int]) -> None:
        self.received: list[Message] = []
        self._to = to
        self._link = Link(("127.0.0.1", 0), to, on_message=lambda got, _: self.received.append(got))

    def send(
        self, msg_type: int, topic: str, stamp_nanos: int, body: bytes, link: str = ""
    ) -> None:
        self._link.send(msg_type, topic, link, stamp_nanos, body)
        assert self._link.flush(10.0)

    def skip(self, msg_type: int, topic: str) -> None:
        """Lose a message on the way: its number is missing."""
        with self._link._wake:
            self._link._queues[self._to].delivery.next_number((msg_type, topic), 1, 0)

    def refuse(self) -> None:
        """Send what is no datagram of the bridge."""
        self._link._socket.send([b"garbage"], self._to)

    def reach(self, listener: Process, msg_type: int, topic: str, body: bytes) -> None:
        """Send a message until the listener got it: from then on DDS knows of both ends."""

        def is_heard() -> bool:
            self.send(msg_type, topic, 0, body)
            time.sleep(0.02)
            return bool(listener.messages(topic))

        wait_until(is_heard, f"the first message of {topic}")

    def of_type(self, msg_type: int) -> list[Message]:
        return [message for message in list(self.received) if message.msg_type == msg_type]

    def close(self) -> None:
        self._link.close()


@pytest.fixture
def ros() -> Iterator[Ros]:
    pytest.importorskip("rclpy", reason="no ROS 2 here")
    running = Ros()
    yield running
    running.end()


@pytest.fixture
def bridge(ros: Ros) -> Iterator[FarEnd]:
    """The far end of a running node."""
    _, address = ros.bridge()
    far_end = FarEnd(address)
    yield far_end
    far_end.close()
