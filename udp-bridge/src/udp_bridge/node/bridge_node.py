# SPDX-License-Identifier: Apache-2.0
"""The bridge's end in a ROS graph, for either ROS: a link, a publish queue and subscriptions.

Threads: the link's receiving thread passes messages on, the queue's thread publishes them, and the
thread that calls `turn` sends messages of ROS and replies in lockstep. The ROS packages supply
publishers, subscriptions and the graph; they decode no message.
"""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import Any, Callable, Mapping, NamedTuple

from udp_bridge import Link, Message
from udp_bridge.io.address_guard import open_socket
from udp_bridge.io.udp_socket import buffer_hint
from udp_bridge.wire import control
from udp_bridge.wire.control import Barrier, RunCommandReply, Subscribe, WorldReply
from udp_bridge.wire.header import BadMessage
from udp_bridge.wire.keys import RefusalHints, read_key
from udp_bridge.wire.message import Address
from udp_bridge.wire.seal import FROM_ROS
from udp_bridge.wire.types import CONTROL, ROS_TYPES, SUBSCRIBE

from .command_client import GatewayRequest, RunCommandClient
from .lockstep import BarrierResponder
from .lockstep_trace import LockstepTrace
from .log import Log
from .options import DEFAULT_BIND, parse_address, parse_datagram, parse_flag, parse_repair
from .publish_queue import PublisherFactory, PublishQueue
from .responses import RosGraph
from .subscriptions import LeasedSubscriptions, SubscriptionFactory

LIVENESS_VARIABLE = "ALIVE_FILE"
"""Environment variable with the name of the liveness file; without it nothing is touched."""
LIVENESS_PERIOD_NANOS = 1_000_000_000


class Settings(NamedTuple):
    """Settings of a node as text, by the names of its ROS parameters."""

    bind: str = DEFAULT_BIND
    """Address to receive at, ``HOST:PORT``."""
    peer: str = ""
    """The only sender to accept (port 0: any port of that host; empty: any sender)."""
    allow_any_peer: str = "false"
    """``true`` or ``false``: may `bind` be reached from other hosts without a peer and a key?"""
    key_file: str = ""
    key_env: str = ""
    """A file, or an environment variable, with the key that seals all datagrams."""
    datagram: str = "loopback"
    repair: str = "none"
    """Datagram size and repair mode of messages that the node sends."""
    trace: str = ""
    """A file for what ROS gets and answers in lockstep; empty for none."""


class BridgeNode:
    """One end of a bridge, from the constructor until `close`.

    Parameters
    ----------
    publishers, subscriptions, graph
        Access to ROS.
    wake
        Wakes the thread that calls `turn`; called from any thread.

    Raises
    ------
    ValueError
        When a setting is invalid, or the key can't be used.
    OSError
        When an address can't be resolved or bound, or the trace can't be written.
    """

    def __init__(
        self,
        settings: Settings,
        publishers: PublisherFactory,
        subscriptions: SubscriptionFactory,
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
        # Without `is_known`, the socket accepts datagrams of known addresses alone.
        is_known = getattr(socket, "is_known", lambda _: True)
        self._trace = LockstepTrace(settings.trace) if settings.trace else None
        self._is_constructed = threading.Event()
        self._log = Log(publishers.get_logger())
        self.command_client = RunCommandClient(self._send_request)
        self._queue = PublishQueue(publishers, self._report_result, is_known)
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
            self._queue.close()
            raise
        self._subscriptions = LeasedSubscriptions(
            subscriptions,
            is_published=self._queue.publishes,
            is_known=is_known,
            repair=repair,
            on_message=lambda topic, sample: self._lockstep.received(topic, sample),
        )
        self._lockstep = BarrierResponder(
            *(graph, self._queue, self._subscriptions),
            log=self._log,
            wake=wake,
            drop=self.link.dropped,
            trace=self._trace,
        )
        self._liveness, self._hints = NodeLiveness(os.environ), RefusalHints()
        self._is_constructed.set()

    def log_start(self, more: str = "") -> None:
        """Log the address, and a hint when the receive buffer is small."""
        host, port = self.link.address
        self._log.info(f"receiving at {host}:{port}{more}")
        if hint := buffer_hint(self.link.receive_buffer):
            self._log.warning(hint)

    def turn(self, now_nanos: int) -> float:
        """Do what is due; return the seconds until something else may be."""
        wait_s = self._subscriptions.turn(self.link, now_nanos)
        self._lockstep.turn(self.link)
        if self._liveness.is_due(now_nanos):
            counts = self.link.counters()
            self._liveness.touch(counts["received_datagrams"], now_nanos)
            for line in self._hints.new(counts["refused"]):
                self._log.warning(line)
        return wait_s

    def close(self, refused: int = 0) -> None:
        """End all threads and log the totals.

        Parameters
        ----------
        refused
            Messages that the ROS package refused.
        """
        self.link.close()
        self._queue.close()
        if self._trace is not None:
            self._trace.close()
        if refusals := self._queue.refusals:
            reasons = ", ".join(f"{reason} {count}" for reason, count in sorted(refusals.items()))
            self._log.info(f"not published, by reason: {reasons}")
        counts: Any = self.link.counters()
        refused += sum(counts["refused"].values()) + self._queue.refused
        self._log.info(
            f"{self._queue.published} messages published on {self._queue.topic_count} topics, "
            f"{self._subscriptions.sent} sent back; lost {counts['missing']}, "
            f"superseded {self._queue.dropped}, refused {refused}"
        )

    def _take(self, message: Message, sender: Address) -> None:
        self._is_constructed.wait()  # the link's thread starts before our constructor returns
        if message.msg_type in ROS_TYPES:
            if not self._lockstep.holds(message, sender):
                self._queue.put(message, sender)
        elif message.msg_type == SUBSCRIBE:
            self._subscriptions.put(Subscribe.parse(message.body), message.topic, sender)
            self.command_client.gateway_seen(sender)
        elif message.msg_type == CONTROL:
            body = control.parse(message.body)
            if isinstance(body, (RunCommandReply, WorldReply)):
                self.command_client.reply_received(body, sender)
            elif isinstance(body, Barrier):
                self._lockstep.take(body, sender, self.link)

    def _send_request(self, request: GatewayRequest, to: Address) -> None:
        self.link.send(CONTROL, "", "", time.time_ns(), request.pack(), to)

    def _report_result(self, message: Message, sender: Address, is_published: bool) -> None:
        (self.link.published if is_published else self.link.dropped)(message, sender)


class NodeLiveness:
    """Liveness file: touched once a second while the node runs and receives from a gateway.

    A container's health check needs only the file's age. A gateway repeats its subscriptions every
    second, so it is received from even while sim time is paused.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        name = environment.get(LIVENESS_VARIABLE)
        self._file = Path(name) if name else None
        self._due_nanos = 0
        self._received = 0

    def is_due(self, now_nanos: int) -> bool:
        """Return whether a second has passed since the last call of `touch`."""
        return now_nanos >= self._due_nanos

    def touch(self, received_datagrams: int, now_nanos: int) -> None:
        """Touch the file when more datagrams have been received than at the last call."""
        self._due_nanos = now_nanos + LIVENESS_PERIOD_NANOS
        if self._file is not None and received_datagrams != self._received:
            self._received = received_datagrams
            self._file.touch()
