# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.gateway``: joins a run and is its door to ROS."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from msgspec.structs import replace

from groundlink.bus.session import Bus, BusError
from groundlink.core.errors import UserError
from groundlink.core.extras import process_needs
from groundlink.messages.base import Ack, Clock
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.process.name_claim import claim_name
from groundlink.scenario import Scenario
from groundlink.scenario.ros_side import Gateway as GatewaySettings

with process_needs("gateway", "gateway"):
    from services.gateway.lockstep.lockstep import REPAIR, Lockstep
    from services.gateway.lockstep.reply_mailbox import ReplyMailbox
    from udp_bridge.io.link import DEFAULT_RECEIVE_BUFFER, Link
    from udp_bridge.io.memory import keep_memory
    from udp_bridge.io.socket_wrappers import PeersOnly, Sealed
    from udp_bridge.io.udp_socket import DatagramSocket, UdpSocket, buffer_hint
    from udp_bridge.wire.header import BadMessage
    from udp_bridge.wire.keys import BadKey, RefusalHints, read_key
    from udp_bridge.wire.printable import printable
    from udp_bridge.wire.seal import TO_ROS
    from udp_bridge.wire.types import CONTROL

    from .bus_session import NAME, BusSession
    from .emulated_socket import EmulatedSocket
    from .forwarder import Forwarder
    from .gateway import Gateway
    from .memory import known_of, memory_of, recall
    from .peer_resolver import PeerResolver
    from .rmw_zenoh import RmwZenohBridge
    from .streams import repair_table, waiting_table
    from .subscribers import Address

RECEIVE_WAIT_SECONDS = 0.1
"""How long a receiving thread sleeps at most."""

SWITCH_SECONDS = 5e-4
"""After this long a thread that waits for the interpreter gets it. Python's own 5 ms are the age of
a small message several times over."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run the gateway until `stop` is set."""
    parser = process.parser(NAME, "Carry a run's streams to ROS and ROS's commands back.")
    parser.add_argument("--bind", metavar="HOST:PORT", help="instead of the scenario's")
    parser.add_argument("--peer", metavar="HOST:PORT", help="instead of the scenario's")
    parser.add_argument("--key-file", metavar="FILE", help="instead of the scenario's key")
    options = parser.parse_args(arguments)
    sys.setswitchinterval(SWITCH_SECONDS)
    keep_memory()
    with Bus(connect=process.endpoint(options), name=NAME) as bus:
        run, scenario = join(bus, options.run, stop)
        claim = claim_name(bus, run, NAME)
        changed: Scenario | None = scenario
        kept = BusSession(bus, run, claim)
        peer = PeerResolver(options.peer or scenario.gateway.peer, process.address)
        try:
            while changed is not None and peer.known(stop, _say) is not None:
                changed = _carry(kept, changed, options, peer, stop)
        finally:
            peer.close()
            kept.wishes.close()


def _carry(
    kept: BusSession,
    scenario: Scenario,
    options: argparse.Namespace,
    peer_now: PeerResolver,
    stop: threading.Event,
) -> Scenario | None:
    """Carry a scenario's streams until `stop` is set, or they have to begin anew.

    That is so with other vehicles, or a peer that is elsewhere now; returns the scenario then.
    """
    inbox = kept.inbox
    bind = process.address(options.bind or scenario.gateway.bind)
    peer = peer_now.address
    assert peer is not None, "it is known by now"
    words = ReplyMailbox() if scenario.time.lockstep == "ros" else None
    gateway = Gateway(
        scenario,
        kept.run,
        peer=peer,
        publish=lambda key, message: kept.publishers[key](message),
        on_wish=kept.wishes.take,
        words=words,
    )
    kept.declare(gateway)
    around, emulated = sockets(scenario.gateway, bind, peer, options.key_file)
    if emulated is not None:
        kept.emulates(emulated)
    try:
        link = Link(
            bind,
            peer,
            socket=around,
            datagram=scenario.gateway.datagram,
            signed_peer=scenario.gateway.signed_peer,
            on_message=gateway.on_message,
            report=True,
            repair=repair_table(gateway.streams.values())
            if words is None
            else dict.fromkeys(gateway.places, REPAIR),
            large_waiting=waiting_table(gateway.streams.values()),
        )
    except BaseException as error:
        around.close()
        if isinstance(error, BadMessage):
            raise UserError(str(error)) from None
        raise
    with link, native(scenario, gateway):
        kept.wishes.tell_by(
            lambda answer: link.send(CONTROL, "", "", time.time_ns(), answer.pack())
        )
        if words is None:
            kept.subscribe(gateway)
        else:
            kept.subscribe_in_order(gateway, scenario)
        heartbeat, misfits = kept.heartbeat, RefusalHints()
        following = _following(kept, gateway, link, words, scenario, emulated)
        while not stop.is_set():
            if arrived := following.listen(inbox):
                key, message = arrived
                if isinstance(message, Clock):
                    if gateway.note_time(message):
                        recall(_known(kept, message), gateway, emulated)
                    if emulated is not None:
                        emulated.at(message.stamp_nanos - message.epoch_nanos)
                following.hear(key, message)
            following.turn(time.monotonic())
            gateway.hear_native()
            if heartbeat.due():
                changed = kept.changed(scenario, stop)
                if changed or peer_now.address != peer:
                    kept.left = gateway.life, memory_of(gateway, emulated)
                if changed:
                    return changed
                if (now := peer_now.address) != peer and now is not None:
                    _say(f"the peer is at {now[0]} now")
                    return scenario
                gateway.repeat(link)
                streams, counts = gateway.report(link, inbox.dropped_of)
                wire = link.counters()
                for line in misfits.new(wire["refused"]):
                    _say(line)
                counts |= {
                    "bus_dropped": inbox.dropped,
                    "bus_refused": inbox.refused,
                    "wire_refused": sum(wire["refused"].values()),
                    **{f"wire_refused_{why}": n for why, n in wire["refused"].items()},
                    "wire_superseded": wire["superseded"],
                    "wire_errors": wire["errors"],
                    "wire_deaf": wire["deaf"],
                    "wire_stalls": wire["stalls"],
                    "wire_kernel_drops": wire["kernel_drops"],
                    "wire_resent": wire["resent"],
                    "wire_resend_refused": wire["resend_refused"],
                }
                if emulated is not None:
                    counts |= emulated.counters()
                counts |= following.counts
                heartbeat.beat(following.tick, counts, streams, is_well=not wire["deaf"])
    return None


def _say(line: str) -> None:
    print(f"{NAME}: {printable(line)}", file=sys.stderr, flush=True)  # names come from the peer


def _known(kept: BusSession, begins: Clock) -> bytes:
    """Return what is known of this gateway's predecessors as a life begins for it."""
    life, memory = kept.left
    if life == begins.life:
        return memory
    return known_of(kept.bus, kept.run) if begins.tick else b""


@contextmanager
def native(scenario: Scenario, gateway: Gateway) -> Iterator[None]:
    """Let a gateway be there for nodes of rmw_zenoh meanwhile, if the scenario wants that."""
    settings = scenario.gateway.rmw_zenoh
    if settings is None:
        yield
        return
    try:
        theirs = Bus(connect=settings.connect, foreign=True)
    except BusError as error:
        raise UserError(f"`gateway.rmw_zenoh.connect`: {error}") from None
    with theirs as bus:
        wanted = [(wish.msg_type, wish.topic) for wish in gateway.incoming]
        gateway.native = RmwZenohBridge(bus, settings, gateway.pushed, wanted, gateway.latched)
        yield


def _following(
    kept: BusSession,
    gateway: Gateway,
    link: Link,
    words: ReplyMailbox | None,
    scenario: Scenario,
    emulated: EmulatedSocket | None,
) -> Forwarder | Lockstep:
    """Return how this gateway follows its run, as the scenario says."""

    def acknowledge(ack: Ack) -> None:
        kept.acknowledge(replace(ack, memory=memory_of(gateway, emulated)))

    if words is None:
        return Forwarder(scenario, gateway, link, acknowledge=acknowledge)
    return Lockstep(
        *(scenario, gateway, link, words),
        acknowledge=acknowledge,
        resume=kept.resumed,
        say=_say,
    )


def sockets(
    settings: GatewaySettings, bind: Address, peer: Address, key_file: str | None
) -> tuple[DatagramSocket, EmulatedSocket | None]:
    """Return what the link sends by, and the emulated link in it if there is one.

    Datagrams pass the guard first, so that strangers are refused before all else, and are opened
    last, so that an emulated bit error meets the seal. One line on stderr tells of a receive buffer
    that is too small.

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
        peers.append(process.address(text) if ":" in text else process.address(f"{text}:0"))
    try:
        bare = UdpSocket(bind, receive_buffer=DEFAULT_RECEIVE_BUFFER, wait_s=RECEIVE_WAIT_SECONDS)
    except OSError as error:
        raise UserError(
            f"{error.strerror}. Fix: end the other process there or change `gateway.bind`"
        ) from None
    if hint := buffer_hint(bare.receive_buffer, DEFAULT_RECEIVE_BUFFER):
        _say(hint)
    around: DatagramSocket = PeersOnly(bare, peers)
    emulated = None
    if settings.link is not None:
        around = emulated = EmulatedSocket(around, settings.link, flips=secret is not None)
    if secret is not None:
        around = Sealed(around, secret, sends=TO_ROS)
    return around, emulated


if __name__ == "__main__":
    process.run(NAME, main)
