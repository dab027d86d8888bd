# SPDX-License-Identifier: Apache-2.0
"""Transports to ROS with one interface: send a message and return its latency.

Each has its receiver in another process. Bodies are an Image in CDR of the given size, except for
ROS#, which sends the same pixels as JSON, and the C program, which repeats one value.
"""

import base64
import json
import socket
import struct
import subprocess
import time
from pathlib import Path
from typing import Protocol

from websockets.sync.client import connect

from .images import IMAGE_HEAD_BYTES, TOPIC, image_cdr, random_pixels
from .processes import LineProcess, python

HERE = Path(__file__).parent
LOCALHOST = "127.0.0.1"
RECEIVERS = "benchmarks.bridge.receivers"
RECEIVE_BUFFER = 8 << 20
"""Granted without privileges where net.core.rmem_max is 4 MiB."""


class Transport(Protocol):
    """Sends single messages."""

    name: str

    began_nanos: int
    """When the last message was sent, by the host's monotonic clock."""

    def send(self, size: int) -> float:
        """Send a message of about `size` bytes, wait for it, return what it took in ms."""

    def close(self) -> None:
        """End its processes."""


class StreamingTransport(Protocol):
    """Sends consecutive messages."""

    name: str

    def stream(self, size: int, count: int) -> float:
        """Send `count` messages, wait until all of them have arrived, return what it took in ms."""


class CProgram:
    """`rival.c`, compiled with -O2, on both sides; its receiver publishes nothing."""

    name = "C program"
    began_nanos = 0

    def __init__(self, folder: Path) -> None:
        program = str(folder / "rival")
        subprocess.run(["cc", "-O2", "-o", program, str(HERE / "rival.c")], check=True)
        self._receiver = LineProcess(program, "receive", str(RECEIVE_BUFFER))
        port = str(self._receiver.number())
        self._sender = LineProcess(program, "send", str(RECEIVE_BUFFER), port)

    def send(self, size: int) -> float:
        """See `Transport`."""
        return self.stream(size, 1)

    def stream(self, size: int, count: int) -> float:
        """See `StreamingTransport`."""
        self._sender.say(f"{size} {count}")
        self.began_nanos = self._sender.number()
        return ([self._receiver.number() for _ in range(count)][-1] - self.began_nanos) / 1e6

    def close(self) -> None:
        """See `Transport`."""
        self._sender.close()
        self._receiver.close()


class Tcp:
    """Length and body by TCP without Nagle's delay."""

    name = "TCP"
    began_nanos = 0

    def __init__(self) -> None:
        self._receiver = python(RECEIVERS, "tcp")
        self._socket = socket.create_connection((LOCALHOST, self._receiver.number()))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, size: int) -> float:
        """See `Transport`."""
        body = image_cdr(size)
        self.began_nanos = time.monotonic_ns()
        self._socket.sendall(struct.pack("<Q", len(body)))
        self._socket.sendall(body)
        return (self._receiver.number() - self.began_nanos) / 1e6

    def close(self) -> None:
        """See `Transport`."""
        self._socket.close()
        self._receiver.close()


class PlainRos:
    """A plain ROS 2 node that publishes a message which is filled beforehand."""

    name = "plain ROS"
    began_nanos = 0

    def __init__(self) -> None:
        self._publisher = python(RECEIVERS, "plain")
        self._publisher.number()

    def send(self, size: int) -> float:
        """See `Transport`. It takes 0 ms until the call of `publish`, which is the beginning."""
        self._publisher.say(str(size))
        self.began_nanos = self._publisher.number()
        return 0.0

    def close(self) -> None:
        """See `Transport`."""
        self._publisher.close()


class RosSharp:
    """rosbridge's `publish`: JSON with base64 in a WebSocket."""

    name = "ROS# way"
    began_nanos = 0

    def __init__(self, *receiver: str) -> None:
        self._receiver = python(RECEIVERS, *(receiver or ("ros_sharp",)))
        url = f"ws://{LOCALHOST}:{self._receiver.number()}"
        self._connection = connect(url, max_size=None, compression=None)
        self._call("advertise", type="sensor_msgs/msg/Image")

    def send(self, size: int) -> float:
        """See `Transport`."""
        data = random_pixels(max(0, size - IMAGE_HEAD_BYTES))
        self.began_nanos = time.monotonic_ns()
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "camera"}
        message = {
            "header": header,
            "height": 1,
            "width": len(data),
            "encoding": "mono8",
            "step": len(data),
            "data": base64.b64encode(data).decode("ascii"),
        }
        self._call("publish", msg=message)
        return (self._receiver.number() - self.began_nanos) / 1e6

    def _call(self, operation: str, **more: object) -> None:
        self._connection.send(json.dumps({"op": operation, "topic": "/image", **more}))

    def close(self) -> None:
        """See `Transport`."""
        self._connection.close()
        self._receiver.close()


class Rosbridge(RosSharp):
    """The same calls to a real rosbridge, which somebody has installed."""

    name = "rosbridge"

    def __init__(self, program: Path) -> None:
        super().__init__("rosbridge", f"--program={program}")


class RosTcpEndpoint:
    """A real ROS-TCP-Endpoint, and its client as Unity's ROS-TCP-Connector.

    A message is a topic and a body, each after its length as uint32. Topics that begin with `__`
    are commands, whose body is JSON that ends with a NUL. What the endpoint sends is not read.
    """

    name = "TCP-Endpoint"
    began_nanos = 0

    def __init__(self, folder: Path) -> None:
        self._receiver = python(RECEIVERS, "ros_tcp_endpoint", f"--program={folder}")
        self._socket = socket.create_connection((LOCALHOST, self._receiver.number()))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        command = {"topic": TOPIC, "message_name": "sensor_msgs/Image"}
        self._write("__publish", json.dumps(command).encode() + b"\0")

    def send(self, size: int) -> float:
        """See `Transport`."""
        body = image_cdr(size)
        self.began_nanos = time.monotonic_ns()
        self._write(TOPIC, body)
        return (self._receiver.number() - self.began_nanos) / 1e6

    def _write(self, topic: str, body: bytes) -> None:
        name = topic.encode()
        head = struct.pack(f"<I{len(name)}sI", len(name), name, len(body))
        sent = self._socket.sendmsg([head, body])
        self._socket.sendall(memoryview(body)[sent - len(head) :])

    def close(self) -> None:
        """See `Transport`."""
        self._socket.close()
        self._receiver.close()
