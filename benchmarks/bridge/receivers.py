# SPDX-License-Identifier: Apache-2.0
"""The ROS side of each way, a process of its own: `python -m benchmarks.bridge.receivers WAY`.

It prints its port, and then for each message when it was whole and when `publish` was called, in
nanoseconds of the host's monotonic clock. Nothing else is measured here.
"""

from __future__ import annotations

import array
import base64
import json
import os
import socket
import struct
import sys
import threading
import time
from typing import Any

import rclpy
from sensor_msgs.msg import Image
from websockets.sync.server import ServerConnection, serve

from udp_bridge import Link, Message

TOPIC = "/image"
_IMAGE_TYPE = 33
_SIZE = struct.Struct("<Q")


class Publishing:
    """A publisher that tells when it is called."""

    def __init__(self, way: str) -> None:
        rclpy.init()
        self._node = rclpy.create_node(f"receiver_of_{way}")
        self._publisher = self._node.create_publisher(Image, TOPIC, 1)

    def publish(self, message: Any, whole_nanos: int) -> None:
        """Publish a message, or its bytes, and tell when."""
        nanos = time.monotonic_ns()
        self._publisher.publish(message)
        os.write(1, f"{whole_nanos} {nanos}\n".encode())


def udp_bridge(publishing: Publishing) -> None:
    """Receive by the library, as the ROS 2 node does: bodies go on as bytes."""

    def on_message(message: Message, _: object) -> None:
        if message.msg_type == _IMAGE_TYPE:
            nanos = time.monotonic_ns()
            publishing.publish(bytes(message.body), nanos)

    with Link(("127.0.0.1", 0), on_message=on_message) as link:
        print(link.address[1], flush=True)
        threading.Event().wait()


def tcp(publishing: Publishing) -> None:
    """Receive length and body by TCP."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        connection, _ = server.accept()
    buffer = bytearray(1 << 24)
    view = memoryview(buffer)
    with connection:
        while head := connection.recv(_SIZE.size, socket.MSG_WAITALL):
            (size,) = _SIZE.unpack(head)
            received = 0
            while received < size:
                received += connection.recv_into(view[received:size])
            nanos = time.monotonic_ns()
            publishing.publish(bytes(view[:size]), nanos)


def ros_sharp(publishing: Publishing) -> None:
    """Receive as rosbridge does: JSON in a WebSocket, binary as base64, a message to be filled."""

    def handle(connection: ServerConnection) -> None:
        for text in connection:
            call = json.loads(text)
            nanos = time.monotonic_ns()
            fields = call["msg"]
            message = Image()
            message.header.frame_id = fields["header"]["frame_id"]
            message.header.stamp.sec = fields["header"]["stamp"]["sec"]
            message.header.stamp.nanosec = fields["header"]["stamp"]["nanosec"]
            message.height, message.width = fields["height"], fields["width"]
            message.encoding, message.step = fields["encoding"], fields["step"]
            message.data = array.array("B", base64.b64decode(fields["data"]))
            publishing.publish(message, nanos)

    with serve(handle, "127.0.0.1", 0, max_size=None, compression=None) as server:
        print(server.socket.getsockname()[1], flush=True)
        server.serve_forever()


WAYS = {"udp_bridge": udp_bridge, "tcp": tcp, "ros_sharp": ros_sharp}

if __name__ == "__main__":
    WAYS[sys.argv[1]](Publishing(sys.argv[1]))
