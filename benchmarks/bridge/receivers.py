# SPDX-License-Identifier: Apache-2.0
"""Receiver process of each transport: `python -m benchmarks.bridge.receivers`.

It prints its port, and then for each message the time at which `publish` was called, or without ROS
the time of delivery, in nanoseconds of the host's monotonic clock. It prints after `publish` has
returned, so that it does not disturb the measurement.
"""

import argparse
import array
import base64
import contextlib
import json
import os
import runpy
import signal
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

from udp_bridge import Link, Message
from udp_bridge.io.memory import keep_memory
from udp_bridge.io.udp_socket import RECOMMENDED_BUFFER

from .images import IMAGE, TOPIC, image_cdr
from .lossy import lossy_socket

_SIZE = struct.Struct("<Q")


def report(number: int) -> None:
    """Print a time, or a port."""
    os.write(1, b"%d\n" % number)


def reported(publish: Callable[[Any], object], message: Any) -> None:
    """Publish a message and report when."""
    nanos = time.monotonic_ns()
    publish(message)
    report(nanos)


class Publisher:
    """A publisher that reports when it is called."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def publish(self, message: Any) -> None:
        """Publish a message, or its bytes, and report when."""
        reported(self._publisher.publish, message)


def plain_node(name: str) -> tuple[Any, Any, Any]:
    """Return a plain node with the DDS settings of ours, the class of an Image, and our QoS."""
    from udp_bridge.node import topic_qos
    from udp_bridge.node.message_class import message_class
    from udp_bridge_ros2 import environment
    from udp_bridge_ros2 import qos as qos_profiles

    environment.apply_defaults(os.environ)
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    qos = qos_profiles.publisher_profile(topic_qos.publisher_qos("Image", TOPIC))
    return rclpy.create_node(name), message_class("sensor_msgs/msg/Image"), qos


def plain_publisher(way: str) -> Publisher:
    """Return a publisher of a plain node."""
    node, image, qos = plain_node(f"receiver_of_{way}")
    return Publisher(node.create_publisher(image, TOPIC, qos))


def callback(_: argparse.Namespace) -> None:
    """Subscribe to images, as a user's node does, and report each callback."""
    import rclpy

    node, image, qos = plain_node("subscriber")
    node.create_subscription(image, TOPIC, lambda _: report(time.monotonic_ns()), qos)
    report(0)  # instead of a port
    rclpy.spin(node)


def plain(_: argparse.Namespace) -> None:
    """Publish images of the sizes on standard input from a plain node; report each call."""
    from rclpy.serialization import deserialize_message

    node, image, qos = plain_node("plain")
    publisher = Publisher(node.create_publisher(image, TOPIC, qos))
    report(0)
    for line in sys.stdin:
        publisher.publish(deserialize_message(image_cdr(int(line)), image))


def node(_: argparse.Namespace) -> None:
    """Run the unchanged ROS 2 node; only its publishers report their calls."""
    from udp_bridge_ros2 import __main__ as start
    from udp_bridge_ros2 import node as module
    from udp_bridge_ros2 import topics
    from udp_bridge_ros2.serialized import serialized_publish

    class ReportingNode(module.Ros2Node):
        def __init__(self, **options: Any) -> None:
            super().__init__(**options)
            print(self._bridge.link.address[1], flush=True)

    def reporting_publish(publisher: Any) -> Callable[[memoryview], None]:
        publish = serialized_publish(publisher)
        return lambda body: reported(publish, body)

    setattr(module, "Ros2Node", ReportingNode)  # noqa: B010
    setattr(topics, "serialized_publish", reporting_publish)  # noqa: B010
    sys.exit(start.main(["--bind", "127.0.0.1:0"]))


def library(options: argparse.Namespace) -> None:
    """Receive by the library alone; its user keeps a message until it has the next one."""
    kept: list[Message] = []

    def on_message(message: Message, _: object) -> None:
        if message.msg_type == IMAGE:
            report(time.monotonic_ns())
            kept[:] = [message]

    lossy = None
    if options.lost:
        lossy = lossy_socket(options.lost, receive_buffer=RECOMMENDED_BUFFER)
    with Link(("127.0.0.1", 0), on_message=on_message, report=True, socket=lossy) as link:
        print(link.address[1], flush=True)
        threading.Event().wait()


def tcp(_: argparse.Namespace) -> None:
    """Receive length and body by TCP."""
    publisher = plain_publisher("tcp")
    with socket.create_server(("127.0.0.1", 0)) as server:
        print(server.getsockname()[1], flush=True)
        connection, _peer = server.accept()
    buffer = bytearray(1 << 24)
    view = memoryview(buffer)
    with connection:
        while head := connection.recv(_SIZE.size, socket.MSG_WAITALL):
            (size,) = _SIZE.unpack(head)
            received = 0
            while received < size:
                received += connection.recv_into(view[received:size])
            publisher.publish(bytes(view[:size]))


def ros_sharp(_: argparse.Namespace) -> None:
    """Receive as rosbridge does: calls in JSON by a WebSocket, of types that clients name."""
    from websockets.sync.server import ServerConnection, serve

    from udp_bridge.node.message_class import message_class

    publisher = plain_publisher("ros_sharp")
    classes: dict[str, type[Any]] = {}

    def advertise(call: dict[str, Any]) -> None:
        classes[call["topic"]] = message_class(call["type"])

    def publish(call: dict[str, Any]) -> None:
        message = classes[call["topic"]]()
        fill(message, call["msg"])
        publisher.publish(message)

    operations = {"advertise": advertise, "publish": publish}

    def handle(connection: ServerConnection) -> None:
        for text in connection:
            call = json.loads(text)
            operations[call["op"]](call)

    with serve(handle, "127.0.0.1", 0, max_size=None, compression=None) as server:
        print(server.socket.getsockname()[1], flush=True)
        server.serve_forever()


def fill(message: Any, fields: dict[str, Any]) -> None:
    """Fill a message of any type from JSON, in which sequences of bytes are base64."""
    types = message.get_fields_and_field_types()
    for name, value in fields.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif types[name] == "sequence<uint8>":
            setattr(message, name, array.array("B", base64.b64decode(value)))
        else:
            setattr(message, name, value)


def rosbridge(options: argparse.Namespace) -> None:
    """Run an unchanged rosbridge; only its publishers report their calls."""
    port = _prepare_server()
    sys.argv = [options.program, "--address", "127.0.0.1", "--port", str(port)]
    sys.argv += ["--max_message_size", str(1 << 27)]  # it refuses more than 10 MB otherwise
    runpy.run_path(options.program, run_name="__main__")


def ros_tcp_endpoint(options: argparse.Namespace) -> None:
    """Run an unchanged ROS-TCP-Endpoint from its folder; only its publishers report their calls."""
    port = _prepare_server()
    sys.path.insert(0, options.program)
    sys.argv = ["endpoint", "--ros-args", "-p", "ROS_IP:=127.0.0.1", "-p", f"ROS_TCP_PORT:={port}"]
    runpy.run_module("ros_tcp_endpoint.default_server_endpoint", run_name="__main__")


def _prepare_server() -> int:
    """Let a node of others report its calls of `publish`; return the port that it is to serve."""
    from udp_bridge_ros2 import environment

    environment.apply_defaults(os.environ)
    from rclpy.node import Node

    create = Node.create_publisher

    def create_reporting(self: Node, *given: Any, **more: Any) -> Any:
        publisher = create(self, *given, **more)
        return Publisher(publisher) if given[1] == TOPIC else publisher

    setattr(Node, "create_publisher", create_reporting)  # noqa: B010
    with socket.create_server(("127.0.0.1", 0)) as free:
        port: int = free.getsockname()[1]
    threading.Thread(target=_report_server, args=[port], daemon=True).start()
    sys.stdout = sys.stderr  # for what it has to say itself
    return port


def _report_server(port: int) -> None:
    """Print the port as soon as somebody serves there."""
    while True:
        with (
            contextlib.suppress(ConnectionRefusedError),
            socket.create_connection(("127.0.0.1", port)),
        ):
            return report(port)
        time.sleep(0.05)


def compute() -> None:
    """Keep the interpreter busy, as a user's own thread may."""
    while True:
        pass


RECEIVERS_BY_NAME = {
    way.__name__: way
    for way in (node, library, tcp, ros_sharp, rosbridge, ros_tcp_endpoint, plain, callback)
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("way", choices=RECEIVERS_BY_NAME)
    parser.add_argument("--busy-thread", action="store_true")
    parser.add_argument("--lost", type=float, default=0.0)
    parser.add_argument("--program")
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    keep_memory()  # The node does; so every receiver has the same settings.
    if given.busy_thread:
        threading.Thread(target=compute, daemon=True).start()
    RECEIVERS_BY_NAME[given.way](given)
