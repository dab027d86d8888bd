# SPDX-License-Identifier: Apache-2.0
"""The ways to carry a message to ROS, all with the same interface: send one, say how long it took.

Each has its receiver in a process of its own. Bodies are an Image in CDR of the wanted size, but
for the ROS# way, which sends the same picture as JSON, and the C program, which sends zeros.
"""

from __future__ import annotations

import base64
import json
import random
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple, Protocol

from websockets.sync.client import connect

from udp_bridge import Link, type_number

HERE = Path(__file__).parent
RECEIVE_BUFFER = 8 << 20
"""What an unprivileged process is granted where net.core.rmem_max is 4 MiB."""
_IMAGE_HEAD_BYTES = 56


class Took(NamedTuple):
    """Milliseconds from the call to send."""

    whole: float
    """Until the message was whole."""
    published: float
    """Until `publish` was called; of the C program the same as `whole`."""


class Way(Protocol):
    """One of them, ready to send."""

    name: str

    def send(self, size: int) -> Took:
        """Send a message of about `size` bytes, and wait until it has arrived."""

    def close(self) -> None:
        """End its processes."""


def picture(size: int) -> bytes:
    """Return incompressible bytes, the same for the same size."""
    return random.Random(size).randbytes(size)


def image_cdr(size: int) -> bytes:
    """Return a sensor_msgs/Image in CDR of `size` bytes or up to 3 more."""
    data = picture(max(0, size - _IMAGE_HEAD_BYTES))
    frame, encoding = b"camera\0", b"mono8\0"
    body = struct.pack("<iI", 0, 0) + struct.pack("<I", len(frame)) + frame
    body += bytes(-len(body) % 4) + struct.pack("<II", 1, len(data))
    body += struct.pack("<I", len(encoding)) + encoding + b"\0"
    body += bytes(-len(body) % 4) + struct.pack("<II", len(data), len(data)) + data
    return b"\x00\x01\x00\x00" + body


class _Receiver:
    def __init__(self, command: list[str]) -> None:
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.port = int(self.line())

    def line(self) -> str:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError("the receiver ended")
        return line

    def took(self, began: int) -> Took:
        times = [int(word) for word in self.line().split()]
        return Took((times[0] - began) / 1e6, (times[-1] - began) / 1e6)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def _python(way: str) -> list[str]:
    return [sys.executable, "-m", "benchmarks.bridge.receivers", way]


class UdpBridge:
    """The library on both sides."""

    name = "UDP Bridge"

    def __init__(self) -> None:
        self._receiver = _Receiver(_python("udp_bridge"))
        self._link = Link(("127.0.0.1", 0), ("127.0.0.1", self._receiver.port))
        self._bodies: dict[int, bytes] = {}

    def send(self, size: int) -> Took:
        """See `Way`."""
        body = self._bodies.setdefault(size, image_cdr(size))
        began = time.monotonic_ns()
        self._link.send(type_number("Image"), "/image", "camera", 0, body)
        return self._receiver.took(began)

    def close(self) -> None:
        """See `Way`."""
        self._link.close()
        self._receiver.close()


class CProgram:
    """`rival.c`, compiled with -O2, on both sides."""

    name = "C program"

    def __init__(self, folder: Path) -> None:
        program = str(folder / "rival")
        subprocess.run(["cc", "-O2", "-o", program, str(HERE / "rival.c")], check=True)
        self._receiver = _Receiver([program, "receive", str(RECEIVE_BUFFER)])
        self._sender = subprocess.Popen(
            [program, "send", str(RECEIVE_BUFFER), str(self._receiver.port)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def send(self, size: int) -> Took:
        """See `Way`."""
        assert self._sender.stdin is not None
        assert self._sender.stdout is not None
        self._sender.stdin.write(f"{size}\n")
        self._sender.stdin.flush()
        return self._receiver.took(int(self._sender.stdout.readline()))

    def close(self) -> None:
        """See `Way`."""
        self._sender.kill()
        self._sender.communicate()
        self._receiver.close()


class Tcp:
    """Length and body by TCP without Nagle's delay."""

    name = "TCP"

    def __init__(self) -> None:
        self._receiver = _Receiver(_python("tcp"))
        self._socket = socket.create_connection(("127.0.0.1", self._receiver.port))
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._bodies: dict[int, bytes] = {}

    def send(self, size: int) -> Took:
        """See `Way`."""
        body = self._bodies.setdefault(size, image_cdr(size))
        began = time.monotonic_ns()
        self._socket.sendall(struct.pack("<Q", len(body)))
        self._socket.sendall(body)
        return self._receiver.took(began)

    def close(self) -> None:
        """See `Way`."""
        self._socket.close()
        self._receiver.close()


class RosSharp:
    """rosbridge's `publish`: JSON with base64 in a WebSocket."""

    name = "ROS# way"

    def __init__(self) -> None:
        self._receiver = _Receiver(_python("ros_sharp"))
        url = f"ws://127.0.0.1:{self._receiver.port}"
        self._connection = connect(url, max_size=None, compression=None)
        self._pictures: dict[int, bytes] = {}

    def send(self, size: int) -> Took:
        """See `Way`."""
        data = self._pictures.setdefault(size, picture(max(0, size - _IMAGE_HEAD_BYTES)))
        began = time.monotonic_ns()
        header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "camera"}
        message = {
            "header": header,
            "height": 1,
            "width": len(data),
            "encoding": "mono8",
            "step": len(data),
            "data": base64.b64encode(data).decode("ascii"),
        }
        self._connection.send(json.dumps({"op": "publish", "topic": "/image", "msg": message}))
        return self._receiver.took(began)

    def close(self) -> None:
        """See `Way`."""
        self._connection.close()
        self._receiver.close()
