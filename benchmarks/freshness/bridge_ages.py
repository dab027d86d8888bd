# SPDX-License-Identifier: Apache-2.0
"""Ages of messages that the bridge carries over the emulated link, on real sockets.

Sender, link and receiver are separate processes. A message's age is the time from its stamp until
its delivery. The link is the project's relay, which loses datagrams, or the network that TCP is
measured on, which loses IP packets: there a datagram is lost with any of its fragments.
"""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections import Counter

from groundlink.emulation import Impairment
from udp_bridge import Link, Message
from udp_bridge.sender.repair import Mode
from udp_bridge.wire.fragments import DatagramSize
from udp_bridge.wire.message import Address

from .tcp_ages import ROW, Arrival
from .two_hosts import HOSTS, run

MSG_TYPE, TOPIC = 1, "/points"
PORT = 5000
_BEGIN_S = 0.5
"""For the receiver to be there before anything is sent."""
_LAST_S = 1.0
"""Wait for what is still being repaired."""


def measure(
    impairment: Impairment,
    *,
    size: int,
    rate_hz: float,
    seconds: float,
    datagram: DatagramSize,
    mode: Mode | None,
    seed: int = 1,
) -> list[Arrival]:
    """Send messages of `size` bytes at a rate for some seconds; return those that arrived."""
    arrived: list[Arrival] = []
    # Stamps are of the wall clock, ages of the steady one: this is what lies between the two.
    offset = time.time_ns() - time.monotonic_ns()

    def on_message(message: Message, _: Address) -> None:
        if message.msg_type == MSG_TYPE:
            arrived.append(Arrival(message.stamp_nanos - offset, time.monotonic_ns()))

    with Link(("127.0.0.1", 0), on_message=on_message) as receiver:
        relay, front = _relay(impairment, receiver.address, seed)
        try:
            # A fresh interpreter: no threads, files or modules of this one.
            sender = multiprocessing.get_context("spawn").Process(
                target=_send, args=(front, size, rate_hz, seconds, datagram, mode, offset)
            )
            sender.start()
            sender.join(seconds + 30.0)
            sender.kill()
            time.sleep(_LAST_S)
        finally:
            relay.send_signal(signal.SIGTERM)
            relay.wait(10.0)
    return arrived


def measure_packets(
    impairment: Impairment,
    *,
    size: int,
    rate_hz: float,
    seconds: float,
    datagram: DatagramSize,
    mode: Mode | None,
    mtu: int,
    blocks: int = 1,
) -> list[Arrival]:
    """Do as `measure` does where IP packets of at most `mtu` bytes are lost.

    Parameters
    ----------
    blocks
        Messages that the data of one instant are sent in; they have arrived with the last one.

    Raises
    ------
    NotAllowed
        When no network can be made.
    """
    results, writing = os.pipe()
    offset = time.time_ns() - time.monotonic_ns()
    to = (HOSTS[1], PORT)

    def send() -> None:
        time.sleep(_BEGIN_S)
        bind = (HOSTS[0], 0)
        _send(to, size, rate_hz, seconds, datagram, mode, offset, bind=bind, blocks=blocks)

    came: Counter[int] = Counter()

    def on_message(message: Message, _: Address) -> None:
        if message.msg_type == MSG_TYPE:
            stamp_nanos = message.stamp_nanos - message.body[0] - offset
            came[stamp_nanos] += 1
            if came[stamp_nanos] == blocks:
                os.write(writing, ROW.pack(stamp_nanos, time.monotonic_ns()))

    def receive() -> None:
        with Link(to, on_message=on_message):
            signal.pause()

    with open(results, "rb") as file:
        run((send, receive), impairment, mtu=mtu, seconds=_BEGIN_S + seconds + _LAST_S)
        os.close(writing)
        return [Arrival(*row) for row in ROW.iter_unpack(file.read())]


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


def _send(
    to: Address,
    size: int,
    rate_hz: float,
    seconds: float,
    datagram: DatagramSize,
    mode: Mode | None,
    offset: int,
    *,
    bind: Address = ("127.0.0.1", 0),
    blocks: int = 1,
) -> None:
    table = {} if mode is None else {(MSG_TYPE, TOPIC): mode}
    bodies = [bytes([block]) + bytes(size // blocks - 1) for block in range(blocks)]
    waiting = {(MSG_TYPE, TOPIC): size if blocks > 1 else 0}
    with Link(bind, to, datagram=datagram, repair=table, queue_limits=waiting) as link:
        begin = time.monotonic_ns()
        for index in range(round(seconds * rate_hz)):
            due = begin + round(index / rate_hz * 1e9)
            time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
            for block, body in enumerate(bodies):  # stamps of their own tell them apart
                link.send(MSG_TYPE, TOPIC, "lidar", due + offset + block, body)
        time.sleep(_LAST_S)
