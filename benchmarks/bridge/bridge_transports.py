# SPDX-License-Identifier: Apache-2.0
"""Transports of this project: from the library's `send`, and from a sensor's publish on the bus.

Both end at the shipped ROS 2 node, or at the library where ROS is not measured.
"""

import os
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from typing import NamedTuple

import msgspec

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.queries import scenario_key
from groundlink.bus.session import Bus
from groundlink.bus.topics import SENSOR_TOPICS
from groundlink.loader import load
from groundlink.monitor.process_commands import free_endpoint
from groundlink.scenario.schema import Scenario
from services.sensors.depth_camera.spec import DepthCamera
from udp_bridge import Link, Message
from udp_bridge.sender.repair import Mode
from udp_bridge.wire.control import LinkReport, parse
from udp_bridge.wire.fragments import LOOPBACK_PART
from udp_bridge.wire.types import CONTROL

from .images import IMAGE, IMAGE_HEAD_BYTES, TOPIC, image_cdr
from .lossy import lossy_socket
from .processes import TIMEOUT_S, LineProcess, ProcessFailed, TimedOut, python
from .transports import HERE, LOCALHOST, RECEIVE_BUFFER, RECEIVERS

PLAIN = {"UDP_BRIDGE_PLAIN": "1"}
"""Environment in which the library receives each datagram in Python."""
_ROOM = HERE.parents[1] / "scenarios" / "indoor_lab.yaml"
_VEHICLE, _CAMERA = "rover", "camera"
_JOIN_S = 2.0
_LOST_TIMEOUT_S = 5.0
"""A message that is not repaired by then is lost: the receiver gives up after 2 s."""


class DeliverySummary(NamedTuple):
    """Outcome of all sent messages, as the receiver reports it."""

    sent: int
    delivered: int
    repaired: int
    kernel_drops: int
    """Datagrams for which the receive buffer had no room."""
    stalls: int
    """Times that the sender waited for a Credit in vain."""
    receive_buffer: int
    """Bytes that the kernel granted to the receiver."""


class UdpBridge:
    """The library as sender, and a receiver process.

    Parameters
    ----------
    receiver
        `node`, the ROS 2 node, or `library`; or a program that does as they do.
    options
        More words for the receiver.
    environment
        More variables for the receiver.
    lost
        Share of the datagrams that each end loses; of the two receivers `library` alone can.
    repair
        How lost ones are made good.
    """

    name = "UDP Bridge"
    began_nanos = 0

    def __init__(
        self,
        receiver: str | LineProcess = "node",
        *options: str,
        environment: Mapping[str, str] | None = None,
        lost: float = 0.0,
        repair: Mode | None = None,
    ) -> None:
        if isinstance(receiver, str):
            words = [*options, f"--lost={lost}"]
            receiver = python(RECEIVERS, receiver, *words, environment=environment)
        self.receiver = receiver
        self._link = Link(
            (LOCALHOST, 0),
            (LOCALHOST, self.receiver.number()),
            on_message=self._on_message,
            repair={(IMAGE, TOPIC): repair} if repair is not None else None,
            socket=lossy_socket(lost, receive_buffer=RECEIVE_BUFFER) if lost else None,
        )
        self._timeout_s = _LOST_TIMEOUT_S if lost else TIMEOUT_S
        self._report: LinkReport | None = None

    def send(self, size: int) -> float:
        """See `Transport`; `TimedOut` is raised when the message was lost for good."""
        return self.stream(size, 1)

    def stream(self, size: int, count: int) -> float:
        """See `StreamingTransport`; each message goes when the one before has left.

        Messages of one part leave at once, in the call of `send`.
        """
        body = image_cdr(size)
        self.began_nanos = time.monotonic_ns()
        for index in range(count):
            if index and size > LOOPBACK_PART:
                self._link.flush(TIMEOUT_S)
            self._link.send(IMAGE, TOPIC, "camera", time.time_ns(), body)
        try:
            times = [self.receiver.number(self._timeout_s) for _ in range(count)]
        except TimedOut:
            counts = (self._link.delivery_counts(), self._link.counters(), self._report)
            raise TimedOut(f"a message has not arrived; {counts}") from None
        return (times[-1] - self.began_nanos) / 1e6

    def summary(self) -> DeliverySummary:
        """Wait until the receiver has reported everything, which it does once a second."""
        self._report = None  # one that was on its way may not know of all
        end = time.monotonic() + TIMEOUT_S
        while time.monotonic() < end:
            for row in self._link.delivery_counts():
                if row.topic == TOPIC and self._report is not None and not row.in_flight:
                    drops, room = self._report.kernel_drops, self._report.receive_buffer
                    stalls = self._link.counters()["stalls"]
                    return DeliverySummary(
                        row.sent, row.delivered, row.repaired, drops, stalls, room
                    )
            time.sleep(0.05)
        raise ProcessFailed("the receiver does not report")

    def close(self) -> None:
        """See `Transport`."""
        self._link.close()
        self.receiver.close()

    def _on_message(self, message: Message, _: object) -> None:
        if message.msg_type == CONTROL and isinstance(report := parse(message.body), LinkReport):
            self._report = report


class BusTransport:
    """A sensor's process, the gateway's process, the node's process.

    Parameters
    ----------
    way
        `local`, as between processes of one machine, or `router`, by Zenoh alone.
    """

    began_nanos = 0

    def __init__(self, way: str = "local") -> None:
        self.name = {"local": "from the bus", "router": "by a router"}[way]
        with ExitStack() as stack:
            self._receiver = stack.enter_context(closing(python(RECEIVERS, "node")))
            peer = f"{LOCALHOST}:{self._receiver.number()}"
            run, endpoint = joined_gateway(stack, _with_camera(load(_ROOM)), peer)
            key = SENSOR_TOPICS["depth_camera"].key_in(run, vehicle=_VEHICLE, sensor=_CAMERA)
            sensor = python("benchmarks.bridge.sensor", endpoint, key, way)
            self._sensor = stack.enter_context(closing(sensor))
            reach(lambda: self.send(1000, _JOIN_S))
            self._all = stack.pop_all()

    def send(self, size: int, timeout_s: float = TIMEOUT_S) -> float:
        """See `Transport`."""
        self._sensor.say(str(max(0, size - IMAGE_HEAD_BYTES)))
        self.began_nanos = self._sensor.number()
        return (self._receiver.number(timeout_s) - self.began_nanos) / 1e6

    def close(self) -> None:
        """See `Transport`."""
        self._all.close()


def joined_gateway(stack: ExitStack, scenario: Scenario, peer: str) -> tuple[str, str]:
    """Start a bus and a gateway that sends to a ROS node; return the run and the bus's endpoint."""
    run, endpoint = f"benchmark_{os.getpid()}", free_endpoint()
    bus = stack.enter_context(Bus(listen=endpoint))
    served = msgspec.msgpack.encode(scenario)
    bus.serve(scenario_key(run), lambda _: [served])
    joined = [f"--connect={endpoint}", f"--run={run}", f"--bind={LOCALHOST}:0", f"--peer={peer}"]
    stack.enter_context(closing(python("services.gateway", *joined)))
    end = time.monotonic() + TIMEOUT_S
    while not bus.present(HEALTH.key_in(run, process="gateway"), seconds=1.0):
        if time.monotonic() > end:
            raise ProcessFailed("the gateway has not joined the bus")
    return run, endpoint


def reach(send: Callable[[], object]) -> None:
    """Send until a message arrives, because neither the bus nor ROS reports its subscribers."""
    for _ in range(15):
        try:
            send()
        except TimedOut:
            continue
        return
    raise ProcessFailed("no message arrives")


def _with_camera(scenario: Scenario) -> Scenario:
    """Return a scenario with one vehicle, which has a camera and nothing else."""
    (vehicle,) = scenario.vehicles
    fields = {"kind": "depth_camera", "name": _CAMERA, "topic": TOPIC, "frame": "camera"}
    camera = msgspec.convert(fields | {"rate_hz": 10.0}, DepthCamera)
    vehicle = msgspec.structs.replace(vehicle, name=_VEHICLE, sensors=(camera,), streams=())
    return msgspec.structs.replace(scenario, vehicles=(vehicle,))
