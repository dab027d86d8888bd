# SPDX-License-Identifier: Apache-2.0
"""Assembly of a gateway: link, streams and follower of one scenario, and their loop."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import msgspec
from msgspec.structs import replace

from groundlink.bus.core_topics import GATEWAY
from groundlink.bus.session import Bus, BusError
from groundlink.core.errors import UserError
from groundlink.emulation.model import DirectionState
from groundlink.messages.base import Ack, Clock
from groundlink.process.runner import address
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import GatewaySettings
from udp_bridge.io.link import Link
from udp_bridge.io.socket_wrappers import PeerFilter, SealedSocket
from udp_bridge.io.udp_socket import RECOMMENDED_BUFFER, DatagramSocket, UdpSocket, buffer_hint
from udp_bridge.wire.header import BadMessage
from udp_bridge.wire.keys import BadKey, RefusalHints, read_key
from udp_bridge.wire.printable import printable
from udp_bridge.wire.run_commands import RunCommandReply
from udp_bridge.wire.seal import TO_ROS
from udp_bridge.wire.types import CONTROL
from udp_bridge.wire.world_queries import WorldReply

from .bus_session import BusSession
from .emulated_socket import EmulatedSocket
from .forwarder import Forwarder
from .gateway import Gateway
from .lockstep.lockstep import REPAIR, Lockstep
from .lockstep.reply_mailbox import ReplyMailbox
from .peer_resolver import PeerResolver
from .rmw_zenoh import RmwZenohBridge
from .streams import queue_limits, repair_table
from .subscribers import Address


class _Memory(msgspec.Struct, array_like=True):
    newest: dict[str, int]
    """By stream: stamp of the newest message that was sent to ROS."""

    counts: dict[str, int]
    link: dict[str, DirectionState]
    """By direction: state of the emulated link's random numbers."""

    next_due: dict[str, int] = {}
    not_come: dict[str, int] = {}
    """See `MissingReadingCounter.memory`."""


class GatewayMemory:
    """Memory of a gateway: what a successor, or a restored run, continues from.

    It is part of the gateway's acknowledgements. Datagrams on the wire or in the emulated link are
    not.
    """

    def __init__(
        self, gateway: Gateway, emulated: EmulatedSocket | None, publish: Callable[[Ack], object]
    ) -> None:
        self._gateway, self._emulated, self._publish = gateway, emulated, publish

    def acknowledge(self, ack: Ack) -> None:
        """Publish an acknowledgement with the memory."""
        self._publish(replace(ack, memory=self.pack()))

    def pack(self) -> bytes:
        """Return the memory."""
        gateway, emulated = self._gateway, self._emulated
        link = {} if emulated is None else emulated.direction_states()
        missing = gateway.missing_readings.memory()
        return msgspec.msgpack.encode(_Memory(gateway.newest, gateway.counts, link, *missing))

    def recall(self, memory: bytes) -> None:
        """Continue from a predecessor's memory, after the first clock of an episode."""
        if not memory:
            return
        known = msgspec.msgpack.decode(memory, type=_Memory)
        self._gateway.newest = known.newest
        self._gateway.counts |= known.counts
        self._gateway.missing_readings.remember(known.next_due, known.not_come)
        if self._emulated is not None:
            self._emulated.restore(known.link)


RECEIVE_WAIT_SECONDS = 0.1
"""Longest time that the receive thread sleeps."""

WIRE_COUNTERS = (
    *("superseded", "errors", "deaf", "stalls"),
    *("kernel_drops", "resent", "resend_refused"),
)
"""Counters of the link that health reports, each with the prefix `wire_`."""


def say(line: str) -> None:
    """Print a line for the user; names in it may come from the peer."""
    print(f"{GATEWAY}: {printable(line)}", file=sys.stderr, flush=True)


class StreamCarrier:
    """Carries the streams of a scenario between the bus and a peer at one address.

    Another carrier replaces it when vehicles join or leave the run, or the peer's address changes.

    Raises
    ------
    UserError
        when the key cannot be read, an address cannot be bound, or a setting is invalid.
    """

    def __init__(
        self,
        session: BusSession,
        scenario: Scenario,
        resolver: PeerResolver,
        bind: Address,
        key_file: str | None,
    ) -> None:
        assert resolver.address is not None, "the caller has waited for an address"
        self._session, self._scenario, self._resolver = session, scenario, resolver
        self._peer, self._hints = resolver.address, RefusalHints()
        replies = ReplyMailbox() if scenario.time.lockstep == "ros" else None
        self._gateway = Gateway(
            scenario,
            session.run,
            peer=self._peer,
            publish=session.publish,
            on_run_command=session.run_commands.put,
            on_world_query=session.world_queries.put,
            replies=replies,
        )
        session.declare(self._gateway)
        with ExitStack() as opened:
            socket, self._emulated = sockets(scenario.gateway, bind, self._peer, key_file)
            if self._emulated is not None:
                session.serve_link(self._emulated)
            self._link = opened.enter_context(
                _link(
                    scenario.gateway, bind, socket, self._gateway, in_lockstep=replies is not None
                )
            )
            opened.enter_context(rmw_zenoh(scenario, self._gateway))
            session.run_commands.reply_with(self._send_reply)
            session.world_queries.reply_with(self._send_reply)
            session.subscribe(self._gateway, scenario, in_order=replies is not None)
            self._heartbeat = session.heartbeat
            self._memory = GatewayMemory(self._gateway, self._emulated, session.acknowledge)
            self._follower: Forwarder | Lockstep
            if replies is None:
                self._follower = Forwarder(
                    *(scenario, self._gateway, self._link), acknowledge=self._memory.acknowledge
                )
            else:
                self._follower = Lockstep(
                    *(scenario, self._gateway, self._link, replies),
                    acknowledge=self._memory.acknowledge,
                    resume=session.status,
                    say=say,
                )
            self._opened = opened.pop_all()

    def __enter__(self) -> "StreamCarrier":
        return self

    def __exit__(self, *error: object) -> None:
        self._opened.close()

    def run(self, stop: threading.Event) -> Scenario | None:
        """Carry streams until `stop` is set; return the scenario for another carrier, if any."""
        while not stop.is_set():
            if arrived := self._follower.listen(self._session.inbox):
                key, message = arrived
                if isinstance(message, Clock):
                    self._take_clock(message)
                self._follower.handle(key, message)
            self._follower.turn(time.monotonic())
            self._gateway.receive_native()
            if self._heartbeat.due():
                if (changed := self._following_scenario(stop)) is not None:
                    return changed
                self._beat()
        return None

    def _take_clock(self, clock: Clock) -> None:
        if self._gateway.note_time(clock):
            self._memory.recall(self._session.memory_at(clock))
        if self._emulated is not None:
            self._emulated.at(clock.stamp_nanos - clock.epoch_nanos)

    def _following_scenario(self, stop: threading.Event) -> Scenario | None:
        """Return what another carrier has to carry; None while this one can go on."""
        changed, peer = self._session.changed(self._scenario, stop), self._resolver.address
        if changed is None and peer == self._peer:
            return None
        self._session.handed_over = self._gateway.episode, self._memory.pack()
        if changed is not None:
            return changed
        assert peer is not None
        say(f"the peer's address is now {peer[0]}")
        return self._scenario

    def _beat(self) -> None:
        """Send what is repeated every second, and publish health."""
        self._gateway.repeat(self._link)
        inbox, wire = self._session.inbox, self._link.counters()
        streams, counts = self._gateway.report(self._link, inbox.dropped_of)
        for line in self._hints.new(wire["refused"]):
            say(line)
        counts |= {
            "bus_dropped": inbox.dropped,
            "bus_refused": inbox.refused,
            "wire_refused": sum(wire["refused"].values()),
            **{f"wire_refused_{reason}": count for reason, count in wire["refused"].items()},
            **{f"wire_{name}": wire[name] for name in WIRE_COUNTERS},
        }
        if self._emulated is not None:
            counts |= self._emulated.counters()
        counts |= self._follower.counts
        self._heartbeat.beat(self._follower.tick, counts, streams, is_well=not wire["deaf"])

    def _send_reply(self, reply: RunCommandReply | WorldReply) -> None:
        self._link.send(CONTROL, "", "", time.time_ns(), reply.pack())


def _link(
    settings: GatewaySettings,
    bind: Address,
    socket: DatagramSocket,
    gateway: Gateway,
    *,
    in_lockstep: bool,
) -> Link:
    """Return the link to the peer, which closes the socket."""
    streams = gateway.streams.values()
    try:
        return Link(
            bind,
            gateway.peer,
            socket=socket,
            datagram=settings.datagram,
            signed_peer=settings.signed_peer,
            on_message=gateway.on_message,
            report=True,
            repair=dict.fromkeys(gateway.topic_keys, REPAIR)
            if in_lockstep
            else repair_table(streams),
            queue_limits=queue_limits(streams),
        )
    except BaseException as error:
        socket.close()
        if isinstance(error, BadMessage):
            raise UserError(str(error)) from None
        raise


@contextmanager
def rmw_zenoh(scenario: Scenario, gateway: Gateway) -> Iterator[None]:
    """Publish the gateway's topics to nodes of rmw_zenoh, too, if the scenario says so."""
    settings = scenario.gateway.rmw_zenoh
    if settings is None:
        yield
        return
    try:
        ros_bus = Bus(connect=settings.connect, foreign=True)
    except BusError as error:
        raise UserError(f"`gateway.rmw_zenoh.connect`: {error}") from None
    with ros_bus as bus:
        wanted = [(each.msg_type, each.topic) for each in gateway.subscriptions]
        gateway.native = RmwZenohBridge(
            *(bus, settings, gateway.pushed, wanted, gateway.latched),
            gateway.typed | gateway.subscriptions.typed,
        )
        yield


def sockets(
    settings: GatewaySettings, bind: Address, peer: Address, key_file: str | None
) -> tuple[DatagramSocket, EmulatedSocket | None]:
    """Return the link's socket, and the emulated link among its wrappers if there is one.

    A received datagram passes the address filter first, so that strangers are refused at once, and
    is decrypted last, so that an emulated bit error meets the seal. Prints a line if the kernel's
    receive buffer is too small.

    Raises
    ------
    UserError
        when the key cannot be read, or the address cannot be bound.
    """
    try:
        if key_file is not None:
            secret = read_key(key_file, None, os.environ)
        else:
            secret = read_key(settings.key_file, settings.key_env, os.environ)
    except BadKey as error:
        raise UserError(str(error)) from None
    peers = [(peer[0], 0)]
    for text in settings.peers:
        peers.append(address(text) if ":" in text else address(f"{text}:0"))
    try:
        bare = UdpSocket(bind, receive_buffer=RECOMMENDED_BUFFER, wait_s=RECEIVE_WAIT_SECONDS)
    except OSError as error:
        raise UserError(
            f"{error.strerror}. Fix: end the other process there or change `gateway.bind`"
        ) from None
    if hint := buffer_hint(bare.receive_buffer, RECOMMENDED_BUFFER):
        say(hint)
    socket: DatagramSocket = PeerFilter(bare, peers)
    emulated = None
    if settings.link is not None:
        socket = emulated = EmulatedSocket(socket, settings.link, flips=secret is not None)
    if secret is not None:
        socket = SealedSocket(socket, secret, sends=TO_ROS)
    return socket, emulated
