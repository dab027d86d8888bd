# SPDX-License-Identifier: Apache-2.0
"""Start with ``python -m services.gateway``: joins a run and is its door to ROS."""

from __future__ import annotations

import socket
import threading
from collections.abc import Sequence

from groundlink import process
from groundlink.bus import Bus
from groundlink.errors import UserError
from groundlink.inbox import Inbox
from groundlink.messages import Ack, Clock, Message
from groundlink.topics import ACK, COMMAND
from udp_bridge.link import Link

from .gateway import Gateway
from .subscriptions import Address

NAME = "gateway"

MESSAGES_KEPT = 4096
"""Messages of the bus that may wait: some seconds of all streams together."""

FLUSH_SECONDS = 1.0
"""How long the link may take to send what waits before progress is told anyway."""


def main(arguments: Sequence[str], stop: threading.Event) -> None:
    """Run the gateway until `stop` is set."""
    parser = process.parser(NAME, "Carry a run's streams to ROS and ROS's commands back.")
    parser.add_argument("--bind", metavar="HOST:PORT", help="instead of the scenario's")
    parser.add_argument("--peer", metavar="HOST:PORT", help="instead of the scenario's")
    options = parser.parse_args(arguments)
    with Bus(connect=process.endpoint(options)) as bus:
        run, scenario = process.join(bus, options.run, stop)
        bind = address(options.bind or scenario.gateway.bind)
        peer = address(options.peer or scenario.gateway.peer)
        inbox: Inbox[Message] = Inbox(depth=MESSAGES_KEPT)
        publishers = {
            key: bus.publisher(key, COMMAND.delivery)
            for key in (COMMAND.key_in(run, vehicle=v.name) for v in scenario.vehicles)
        }
        gateway = Gateway(
            scenario,
            run,
            peer=peer,
            publish_command=lambda key, command: publishers[key](command),
        )
        acknowledge = bus.publisher(ACK.key_in(run, process=NAME), ACK.delivery)
        try:
            link = Link(
                bind,
                peer,
                datagram=scenario.gateway.datagram,
                signed_peer=scenario.gateway.signed_peer,
                on_message=gateway.on_message,
                report=True,
            )
        except OSError as error:
            raise UserError(
                f"cannot bind {bind[0]}:{bind[1]}: {(error.strerror or str(error)).lower()}; end "
                "the other process or change `gateway.bind`"
            ) from None
        with link:
            for key, stream in gateway.streams.items():
                bus.subscribe(key, stream.message, inbox)
            heartbeat = process.Heartbeat(bus, run, NAME)
            # In real time the newest supersedes what waits; otherwise physics is held up.
            waited_for = scenario.time.mode != "realtime"
            tick = -1
            while not stop.is_set():
                if arrived := inbox.get(seconds=0.05):
                    key, message = arrived
                    gateway.forward(key, message, link)
                    if waited_for:
                        link.flush(FLUSH_SECONDS)
                    if isinstance(message, Clock):
                        tick = message.tick
                        acknowledge(Ack(message.epoch_nanos, tick, tick))
                if heartbeat.due():
                    gateway.repeat(link)
                    streams, counts = gateway.report()
                    wire = link.counters()
                    counts |= {
                        "bus_dropped": inbox.dropped,
                        "bus_refused": inbox.refused,
                        "wire_refused": sum(wire["refused"].values()),
                        "wire_superseded": wire["superseded"],
                        "wire_stalls": wire["stalls"],
                        "wire_kernel_drops": wire["kernel_drops"],
                    }
                    heartbeat.beat(tick, counts, streams)


def address(text: str) -> Address:
    """Return `HOST:PORT` as a numeric address.

    Raises
    ------
    UserError
        when it is no address or the host has none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise UserError(f"`{text}` is no address; expected HOST:PORT such as 127.0.0.1:7511")
    try:
        return socket.gethostbyname(host), int(port)
    except OSError:
        raise UserError(f"`{text}`: no host is called `{host}`") from None


if __name__ == "__main__":
    process.run(NAME, main)
