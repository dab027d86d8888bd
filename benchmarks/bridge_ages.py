# SPDX-License-Identifier: Apache-2.0
"""Ages of messages that the bridge carries through the project's own relay, on real sockets.

Rule: sender, relay and receiver are processes of their own, with nothing but the bridge in them.
A message's age is the time from its stamp until it was handed over whole.
"""

from __future__ import annotations

import multiprocessing
import signal
import subprocess
import sys
import time

from groundlink.emulation import Impairment
from udp_bridge import Link, Message
from udp_bridge.fragments import DatagramSize
from udp_bridge.repair import Mode
from udp_bridge.sending import Address

from .tcp_ages import Arrival

MSG_TYPE, TOPIC = 1, "/points"
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
) -> None:
    table = {} if mode is None else {(MSG_TYPE, TOPIC): mode}
    body = bytes(size)
    with Link(("127.0.0.1", 0), to, datagram=datagram, repair=table) as link:
        begin = time.monotonic_ns()
        for index in range(round(seconds * rate_hz)):
            due = begin + round(index / rate_hz * 1e9)
            time.sleep(max(0, due - time.monotonic_ns()) / 1e9)
            link.send(MSG_TYPE, TOPIC, "lidar", due + offset, body)
        time.sleep(_LAST_S)
