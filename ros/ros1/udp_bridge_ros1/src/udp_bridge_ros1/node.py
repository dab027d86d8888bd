# SPDX-License-Identifier: Apache-2.0
"""The node: a link on one side, an outlet and an inlet on the other, and what it tells the user.

Rule: it only wires. The link's receiving thread hands messages over, the outlet's thread
publishes, and the thread that calls `turn` sends back and gives the word in lockstep.
"""

from __future__ import annotations

import os
import time
from typing import Optional

import rospy

from udp_bridge import MSG_TYPES, Link, Message, Refused, control
from udp_bridge.around import sealed_socket
from udp_bridge.control import Barrier, Subscribe, Wish, WishAnswer
from udp_bridge.header import BadMessage
from udp_bridge.keys import Misfits, read_key
from udp_bridge.leaving import Address
from udp_bridge.ros_end.addresses import DEFAULT_BIND, is_from, parse_address, resolve
from udp_bridge.ros_end.alive import Alive
from udp_bridge.ros_end.asking import Asking
from udp_bridge.ros_end.inlet import Inlet
from udp_bridge.ros_end.lockstep import Lockstep
from udp_bridge.ros_end.options import parse_datagram, parse_repair
from udp_bridge.ros_end.outlet import Outlet
from udp_bridge.seal import FROM_ROS
from udp_bridge.types import CONTROL, SUBSCRIBE
from udp_bridge.udp_socket import buffer_hint

from .diagnostics import Diagnostics
from .graph import Graph
from .publishers import Publishers
from .services import Services
from .subscriptions import Subscriptions


class BridgeNode:
    """The ROS 1 end of UDP Bridge, within a node that rospy has begun.

    Its parameters are `~bind`, where it receives, and `~peer`, the only one whose messages it takes
    (port 0: any of that host; empty: whoever sends), both as ``HOST:PORT``. With `~key_file`, a
    file, or `~key_env`, an environment variable, it sends and takes only what is sealed by that
    key. `~datagram` and `~repair` are of what it sends, `~frame_prefix` is put before frames of
    what it publishes.

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
        self,
        *,
        bind: Optional[str] = None,
        key_file: Optional[str] = None,
        key_env: Optional[str] = None,
    ) -> None:
        bind = bind or str(rospy.get_param("~bind", DEFAULT_BIND))
        peer = str(rospy.get_param("~peer", ""))
        key_file = key_file or str(rospy.get_param("~key_file", "")) or None
        key_env = key_env or str(rospy.get_param("~key_env", "")) or None
        datagram = parse_datagram(str(rospy.get_param("~datagram", "loopback")))
        repair = parse_repair(str(rospy.get_param("~repair", "none")))
        secret = read_key(key_file, key_env, os.environ)
        bind_address = parse_address(bind, what="bind")
        self._peer = resolve(parse_address(peer, what="peer")) if peer else None
        self._refused = 0
        publishers = Publishers(str(rospy.get_param("~frame_prefix", "")))
        self._subscriptions = Subscriptions()
        self._outlet = Outlet(publishers, self._fated)
        self._log = publishers.get_logger()
        self._inlet = Inlet(
            self._subscriptions,
            is_published=self._outlet.publishes,
            repair=repair,
            heard=lambda topic: self._lockstep.heard(topic),
        )
        self._lockstep = Lockstep(
            *(Graph(), self._outlet, self._inlet),
            log=self._log,
            wake=self._subscriptions.wake,
            drop=lambda message, sender: self._link.dropped(message, sender),
        )
        self._asking = Asking(self._send_wish)
        try:
            self._link = Link(
                bind_address,
                report=True,
                confirmed=True,
                datagram=datagram,
                on_message=self._take,
                socket=sealed_socket(bind_address, secret, sends=FROM_ROS) if secret else None,
            )
        except (OSError, BadMessage):
            self._outlet.close()
            raise
        self._diagnostics = Diagnostics(self._link, time.monotonic_ns())
        self._alive, self._misfits = Alive(os.environ), Misfits()
        host, port = self._link.address
        self._log.info(f"receiving at {host}:{port}")
        if hint := buffer_hint(self._link.receive_buffer):
            self._log.warning(hint)
        self._services = Services(self._asking, self._log)

    def turn(self) -> None:
        """Serve the wishes of peers for a moment, 0.1 s at most."""
        now_nanos = time.monotonic_ns()
        wait_s = self._inlet.turn(self._link, now_nanos)
        self._lockstep.turn(self._link)
        self._diagnostics.turn(now_nanos)
        if self._alive.is_due(now_nanos):
            counts = self._link.counters()
            self._alive.show(counts["received_datagrams"], now_nanos)
            for line in self._misfits.new(counts["refused"]):
                self._log.warning(line)
        self._subscriptions.turn(wait_s)

    def close(self) -> None:
        """End all threads and say in one line what was done."""
        self._services.close()
        self._link.close()
        self._outlet.close()
        counts = self._link.counters()
        refused = sum(counts["refused"].values()) + self._outlet.refused + self._refused
        self._log.info(
            f"{self._outlet.published} messages published on {self._outlet.topic_count} topics, "
            f"{self._inlet.sent} sent back; lost on the way {counts['missing']}, "
            f"dropped for newer ones {self._outlet.dropped}, "
            f"refused {refused + self._subscriptions.refused}"
        )

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
