# SPDX-License-Identifier: Apache-2.0
"""The node: a link on one side, an outlet and an inlet on the other, and what it tells the user.

Rule: it only wires. The link's receiving thread hands messages over, the outlet's thread
publishes, and the thread that calls `turn` owns the subscriptions.
"""

from __future__ import annotations

import os
import time

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from udp_bridge import MSG_TYPES, Link, Message, Refused, control
from udp_bridge.around import sealed_socket
from udp_bridge.control import Barrier, Subscribe, Wish, WishAnswer
from udp_bridge.header import BadMessage
from udp_bridge.keys import Misfits, read_key
from udp_bridge.ros_end.addresses import DEFAULT_BIND, is_from, parse_address, resolve
from udp_bridge.ros_end.alive import Alive
from udp_bridge.ros_end.asking import Asking
from udp_bridge.ros_end.inlet import Inlet
from udp_bridge.ros_end.lockstep import Lockstep
from udp_bridge.ros_end.options import parse_datagram, parse_repair
from udp_bridge.seal import FROM_ROS
from udp_bridge.types import CONTROL, SUBSCRIBE
from udp_bridge.udp_socket import buffer_hint

from . import environment
from .diagnostics import Diagnostics
from .graph import Graph
from .inlet import Subscriptions
from .outlet import Outlet
from .services import Services

Address = tuple[str, int]

ANY_TYPE = ParameterDescriptor(dynamic_typing=True)
"""Of a parameter that may be a word or a number."""


class BridgeNode(Node):
    """The ROS 2 end of UDP Bridge.

    Its parameters are `bind`, where it receives, and `peer`, the only one whose messages it takes
    (port 0: any of that host; empty: whoever sends), both as ``HOST:PORT``. With `key_file`, a
    file, or `key_env`, an environment variable, it sends and takes only what is sealed by that key.
    `datagram` and `repair` are of what it sends, `frame_prefix` is put before frames of what it
    publishes; `use_sim_time` and `qos_overrides` are those of every node.

    Parameters
    ----------
    bind, key_file, key_env
        Stand before the parameters of these names.

    Raises
    ------
    ValueError
        When an address is none, or the key is none that can be used.
    OSError
        When an address can't be resolved or bound.
    """

    def __init__(
        self, *, bind: str | None = None, key_file: str | None = None, key_env: str | None = None
    ) -> None:
        words = {"bind": bind, "key_file": key_file, "key_env": key_env}
        given = [Parameter(name, value=word) for name, word in words.items() if word is not None]
        super().__init__("udp_bridge", parameter_overrides=given)
        bind = str(self.declare_parameter("bind", DEFAULT_BIND).value)
        peer = str(self.declare_parameter("peer", "").value)
        key_file = str(self.declare_parameter("key_file", "").value) or None
        key_env = str(self.declare_parameter("key_env", "").value) or None
        datagram = str(self.declare_parameter("datagram", "loopback", ANY_TYPE).value)
        repair = str(self.declare_parameter("repair", "none").value)
        frame_prefix = str(self.declare_parameter("frame_prefix", "").value)
        secret = read_key(key_file, key_env, os.environ)
        bind_address = parse_address(bind, what="bind")
        self._peer = resolve(parse_address(peer, what="peer")) if peer else None
        self._refused = 0
        datagram_size, mode = parse_datagram(datagram), parse_repair(repair)
        self._outlet = Outlet(self, self._fated, frame_prefix=frame_prefix)
        self._inlet = Inlet(
            Subscriptions(self),
            is_published=self._outlet.publishes,
            repair=mode,
            heard=lambda topic: self._lockstep.heard(topic),
        )
        wake = self.create_guard_condition(lambda: None)
        self._lockstep = Lockstep(
            *(Graph(self), self._outlet, self._inlet),
            log=self.get_logger(),
            wake=wake.trigger,
            drop=lambda message, sender: self._link.dropped(message, sender),
        )
        self._asking = Asking(self._send_wish)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        try:
            self._link = Link(
                bind_address,
                report=True,
                confirmed=True,
                datagram=datagram_size,
                on_message=self._take,
                socket=sealed_socket(bind_address, secret, sends=FROM_ROS) if secret else None,
            )
        except (OSError, BadMessage):
            self._outlet.close()
            self._executor.shutdown()
            self.destroy_node()
            raise
        self._diagnostics = Diagnostics(self, self._link)
        self._alive, self._misfits = Alive(os.environ), Misfits()
        host, port = self._link.address
        self.get_logger().info(f"receiving at {host}:{port}; {environment.describe(os.environ)}")
        if hint := buffer_hint(self._link.receive_buffer):
            self.get_logger().warning(hint)
        self._run_services = Services(self, self._asking)

    def turn(self) -> None:
        """Serve ROS and the wishes of peers for a moment, 0.1 s at most."""
        now_nanos = time.monotonic_ns()
        wait_s = self._inlet.turn(self._link, now_nanos)
        self._lockstep.turn(self._link)
        self._diagnostics.turn(now_nanos)
        if self._alive.is_due(now_nanos):
            counts = self._link.counters()
            self._alive.show(counts["received_datagrams"], now_nanos)
            for line in self._misfits.new(counts["refused"]):
                self.get_logger().warning(line)
        self._executor.spin_once(timeout_sec=wait_s)

    def close(self) -> None:
        """End all threads and say in one line what was done."""
        self._run_services.close()
        self._link.close()
        self._outlet.close()
        counts = self._link.counters()
        refused = sum(counts["refused"].values()) + self._outlet.refused + self._refused
        self.get_logger().info(
            f"{self._outlet.published} messages published on {self._outlet.topic_count} topics, "
            f"{self._inlet.sent} sent back; lost on the way {counts['missing']}, "
            f"dropped for newer ones {self._outlet.dropped}, refused {refused}"
        )
        self._executor.shutdown()
        self.destroy_node()

    def _take(self, message: Message, sender: Address) -> None:
        if self._peer is not None and not is_from(sender, self._peer):
            self._refused += 1
            self._link.dropped(message, sender)
            return
        row = MSG_TYPES[message.msg_type]
        if row.ros_type is not None:
            if not self._lockstep.holds(message, sender):
                self._outlet.put(row, message, sender)
        elif message.msg_type in (SUBSCRIBE, CONTROL):
            try:
                self._hear(message, sender)
            except Refused:
                self._refused += 1

    def _hear(self, message: Message, sender: Address) -> None:
        if message.msg_type == SUBSCRIBE:
            self._inlet.put(Subscribe.parse(message.body), message.topic, sender)
            self._asking.heard(sender)
            return
        said = control.parse(message.body)
        if isinstance(said, WishAnswer):
            self._asking.answered(said, sender)
        elif isinstance(said, Barrier):
            self._lockstep.take(said, sender, self._link)

    def _send_wish(self, wish: Wish, to: Address) -> None:
        self._link.send(CONTROL, "", "", time.time_ns(), wish.pack(), to)

    def _fated(self, message: Message, sender: Address, is_published: bool) -> None:
        (self._link.published if is_published else self._link.dropped)(message, sender)
