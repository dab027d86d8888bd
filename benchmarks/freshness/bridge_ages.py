# SPDX-License-Identifier: Apache-2.0
"""Ages of messages that the bridge carries over the emulated link, on real sockets.

Sender, link and receiver are separate processes. A message's age is the time from its stamp until
its delivery. The link is the project's relay, which loses datagrams, or the network that TCP is
measured on, which loses IP packets: there a datagram is lost with any of its fragments.
"""

import multiprocessing
import signal
import subprocess
import sys
import time
from collections import Counter
from typing import NamedTuple

from groundlink.emulation.settings import Impairment
from udp_bridge import Link, Message
from udp_bridge.sender.repair import Mode
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.message import Address

from .tcp_ages import BEGIN_S, PORT, Arrival, OnArrival, between_hosts
from .two_hosts import HOSTS

MSG_TYPE, TOPIC = 1, "/points"
LOCAL = ("127.0.0.1", 0)
_LAST_S = 1.0
"""Wait for what is still being repaired."""


class Traffic(NamedTuple):
    """What is sent."""

    size: int
    """Bytes of the data of one instant."""
    rate_hz: float
    seconds: float
    datagram: DatagramSize
    mode: Mode | None
    blocks: int = 1
    """Messages that the data of one instant are sent in; they have arrived with the last one."""


def measure(impairment: Impairment, traffic: Traffic, *, seed: int = 1) -> list[Arrival]:
    """Send messages through the relay; return those that arrived."""
    arrived: list[Arrival] = []
    # Stamps are of the wall clock, ages of the steady one: this is what lies between the two.
    offset = time.time_ns() - time.monotonic_ns()

    def on_message(message: Message, _: Address) -> None:
        if message.msg_type == MSG_TYPE:
            arrived.append(Arrival(message.stamp_nanos - offset, time.monotonic_ns()))

    with Link(LOCAL, on_message=on_message) as receiver:
        relay, front = _relay(impairment, receiver.address, seed)
        try:
            # A fresh interpreter: no threads, files or modules of this one.
            sender = multiprocessing.get_context("spawn").Process(
                target=_send, args=(LOCAL, front, traffic, offset)
            )
            sender.start()
            sender.join(traffic.seconds + 30.0)
            sender.kill()
            time.sleep(_LAST_S)
        finally:
            relay.send_signal(signal.SIGTERM)
            relay.wait(10.0)
    return arrived


def measure_packets(impairment: Impairment, traffic: Traffic, *, mtu: int) -> list[Arrival]:
    """Do as `measure` does where IP packets of at most `mtu` bytes are lost.

    Raises
    ------
    NotAllowed
        When no network can be made.
    """
    offset = time.time_ns() - time.monotonic_ns()
    to = (HOSTS[1], PORT)

    def send() -> None:
        time.sleep(BEGIN_S)
        _send((HOSTS[0], 0), to, traffic, offset)

    def receive(arrived: OnArrival) -> None:
        came: Counter[int] = Counter()

        def on_message(message: Message, _: Address) -> None:
            if message.msg_type == MSG_TYPE:
                stamp_nanos = message.stamp_nanos - message.body[0] - offset
                came[stamp_nanos] += 1
                if came[stamp_nanos] == traffic.blocks:
                    arrived(stamp_nanos)

        with Link(to, on_message=on_message):
            signal.pause()

    return between_hosts(send, receive, impairment, mtu, BEGIN_S + traffic.seconds + _LAST_S)


def _relay(impairment: Impairment, to: Address, seed: int) -> tuple[subprocess.Popen[str], Address]:
    """Start a relay; return it and the address at which it listens."""
    options = {
        "--listen": "127.0.0.1:0",
        "--to": f"{to[0]}:{to[1]}",
        "--loss": str(impairment.loss),
        "--delay-ms": str(impairment.delay_ms),
        "--seed": str(seed),
    }
    command = [sys.executable, "-m", "services.link"]
    command += [word for option in options.items() for word in option]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    host, _, port = line.split(" from ")[1].split(" to ")[0].rpartition(":")
    return process, (host, int(port))


def _send(bind: Address, to: Address, traffic: Traffic, offset: int) -> None:
    key, size, blocks = (MSG_TYPE, TOPIC), traffic.size, traffic.blocks
    table = {} if traffic.mode is None else {key: traffic.mode}
    bodies = [bytes([block]) + bytes(size // blocks - 1) for block in range(blocks)]
    waiting = {key: size if blocks > 1 else 0}
    with Link(bind, to, datagram=traffic.datagram, repair=table, queue_limits=waiting) as link:
        begin = time.monotonic_ns()
        for index in range(round(traffic.seconds * traffic.rate_hz)):
            due = begin + round(index / traffic.rate_hz * 1e9)
            time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
            for block, body in enumerate(bodies):  # stamps of their own tell them apart
                link.send(MSG_TYPE, TOPIC, "lidar", due + offset + block, body)
        time.sleep(_LAST_S)
