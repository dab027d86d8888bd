# SPDX-License-Identifier: Apache-2.0
"""The ROS end of a bridge, whichever ROS: a link on one side, an outlet and an inlet on the other.

Rule: it only wires. The link's receiving thread hands messages over, the outlet's thread publishes,
and the thread that calls `turn` sends back and gives the word in lockstep. What comes before all of
it is there waits for that. Nodes bring what they know of ROS, and read no message here.
"""

from __future__ import annotations

import os
import threading
import time
from typing import Any, Callable, NamedTuple

from udp_bridge import Link, Message
from udp_bridge.io.address_guard import open_socket
from udp_bridge.io.udp_socket import buffer_hint
from udp_bridge.wire import control
from udp_bridge.wire.control import Barrier, RunCommand, RunCommandReply, Subscribe
from udp_bridge.wire.header import BadMessage
from udp_bridge.wire.keys import RefusalHints, read_key
from udp_bridge.wire.message import Address
from udp_bridge.wire.seal import FROM_ROS
from udp_bridge.wire.types import CONTROL, ROS_TYPES, SUBSCRIBE

from . import publish_queue as outlet
from . import subscriptions as inlet
from .addresses import DEFAULT_BIND, parse_address
from .command_client import RunCommandClient
from .liveness_file import NodeLiveness
from .lockstep import BarrierResponder
from .log import Log
from .options import parse_datagram, parse_flag, parse_repair
from .responses import RosGraph


class Settings(NamedTuple):
    """What a user says, by the names of the nodes' parameters, as text."""

    bind: str = DEFAULT_BIND
    """Where it receives, ``HOST:PORT``."""
    peer: str = ""
    """The only sender whose datagrams it takes (port 0: any of that host; empty: any sender)."""
    allow_any_peer: str = "false"
    """``true`` or ``false``: may `bind` be reached from other hosts without a peer and a key?"""
    key_file: str = ""
    key_env: str = ""
    """A file, or an environment variable: it sends and takes only what is sealed by that key."""
    datagram: str = "loopback"
    repair: str = "none"
    """Both of what it sends."""


class BridgeNode:
    """One end of a bridge, from the constructor until `close`.

    Parameters
    ----------
    publishers, subscriptions, graph
        What they need of ROS.
    wake
        Has the thread that calls `turn` wait no longer; from any thread.

    Raises
    ------
    ValueError
        When a setting is none, or the key is none that can be used.
    OSError
        When an address can't be resolved or bound.
    """

    def __init__(
        self,
        settings: Settings,
        publishers: outlet.Ros,
        subscriptions: inlet.Ros,
        graph: RosGraph,
        *,
        wake: Callable[[], object],
    ) -> None:
        bind = parse_address(settings.bind, what="bind")
        datagram, repair = parse_datagram(settings.datagram), parse_repair(settings.repair)
        secret = read_key(settings.key_file or None, settings.key_env or None, os.environ)
        peer = parse_address(settings.peer, what="peer") if settings.peer else None
        socket = open_socket(
            bind,
            peer=peer,
            secret=secret,
            sends=FROM_ROS,
            allow_any_peer=parse_flag(settings.allow_any_peer, what="allow_any_peer"),
        )
        is_known = getattr(socket, "is_known", _everybody)
        self._is_whole = threading.Event()
        self._log = Log(publishers.get_logger())
        self.asking = RunCommandClient(self._send_wish)
        self._outlet = outlet.PublishQueue(publishers, self._fated, is_known)
        try:
            self.link = Link(
                bind,
                report=True,
                confirmed=True,
                datagram=datagram,
                on_message=self._take,
                socket=socket,
            )
        except BadMessage:
            socket.close()
            self._outlet.close()
            raise
        self._inlet = inlet.LeasedSubscriptions(
            subscriptions,
            is_published=self._outlet.publishes,
            is_known=is_known,
            repair=repair,
            heard=lambda topic: self._lockstep.heard(topic),
        )
        self._lockstep = BarrierResponder(
            *(graph, self._outlet, self._inlet), log=self._log, wake=wake, drop=self.link.dropped
        )
        self._alive, self._misfits = NodeLiveness(os.environ), RefusalHints()
        self._is_whole.set()

    def tell_begin(self, more: str = "") -> None:
        """Say in one line where it receives, and in another what the kernel should be told."""
        host, port = self.link.address
        self._log.info(f"receiving at {host}:{port}{more}")
        if hint := buffer_hint(self.link.receive_buffer):
            self._log.warning(hint)

    def turn(self, now_nanos: int) -> float:
        """Serve the wishes of peers; return the seconds until something else may be due."""
        wait_s = self._inlet.turn(self.link, now_nanos)
        self._lockstep.turn(self.link)
        if self._alive.is_due(now_nanos):
            counts = self.link.counters()
            self._alive.show(counts["received_datagrams"], now_nanos)
            for line in self._misfits.new(counts["refused"]):
                self._log.warning(line)
        return wait_s

    def close(self, refused: int = 0) -> None:
        """End all threads and say in one line what was done; `refused` is what the node refused."""
        self.link.close()
        self._outlet.close()
        if refusals := self._outlet.refusals:
            reasons = ", ".join(f"{reason} {count}" for reason, count in sorted(refusals.items()))
            self._log.info(f"not published, by reason: {reasons}")
        counts: Any = self.link.counters()
        refused += sum(counts["refused"].values()) + self._outlet.refused
        self._log.info(
            f"{self._outlet.published} messages published on {self._outlet.topic_count} topics, "
            f"{self._inlet.sent} sent back; lost on the way {counts['missing']}, "
            f"dropped for newer ones {self._outlet.dropped}, refused {refused}"
        )

    def _take(self, message: Message, sender: Address) -> None:
        self._is_whole.wait()  # the link's thread is there before its constructor has returned
        if message.msg_type in ROS_TYPES:
            if not self._lockstep.holds(message, sender):
                self._outlet.put(message, sender)
        elif message.msg_type in (SUBSCRIBE, CONTROL):
            self._hear(message, sender)

    def _hear(self, message: Message, sender: Address) -> None:
        if message.msg_type == SUBSCRIBE:
            self._inlet.put(Subscribe.parse(message.body), message.topic, sender)
            self.asking.heard(sender)
            return
        said = control.parse(message.body)
        if isinstance(said, RunCommandReply):
            self.asking.answered(said, sender)
        elif isinstance(said, Barrier):
            self._lockstep.take(said, sender, self.link)

    def _send_wish(self, wish: RunCommand, to: Address) -> None:
        self.link.send(CONTROL, "", "", time.time_ns(), wish.pack(), to)

    def _fated(self, message: Message, sender: Address, is_published: bool) -> None:
        (self.link.published if is_published else self.link.dropped)(message, sender)


def _everybody(_: Address) -> bool:
    """Return that an address is known: the socket takes datagrams of such addresses alone."""
    return True
