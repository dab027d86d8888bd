# SPDX-License-Identifier: Apache-2.0
"""Ages of messages that the kernel's own TCP carries over the emulated link.

Every choice favors TCP: of the waiting messages only the newest is sent, Nagle's algorithm is off,
bodies are neither serialized nor copied, and the processes do nothing else. A message's age is the
time from its stamp until its last byte was read.
"""

import os
import socket
import struct
import time
from collections.abc import Callable
from typing import NamedTuple

from groundlink.emulation.settings import Impairment

from .two_hosts import HOSTS, run

PORT = 5000
_STAMP = struct.Struct("<Q")
_ROW = struct.Struct("<QQ")
"""How an `Arrival` is told from process to process."""
BEGIN_S = 0.5
"""For the receiver to listen and the connection to open."""


class Arrival(NamedTuple):
    """A delivered message; both times are of one clock."""

    stamp_nanos: int
    at_nanos: int


OnArrival = Callable[[int], object]
"""Called with the stamp of a message that has arrived just now."""


def between_hosts(
    send: Callable[[], None],
    receive: Callable[[OnArrival], None],
    impairment: Impairment,
    mtu: int,
    seconds: float,
) -> list[Arrival]:
    """Run a sender and a receiver on two hosts; return what the receiver tells.

    Raises
    ------
    NotAllowed
        When no network can be made.
    """
    results, writing = os.pipe()

    def arrived(stamp_nanos: int) -> None:
        os.write(writing, _ROW.pack(stamp_nanos, time.monotonic_ns()))

    with open(results, "rb") as file:
        run((send, lambda: receive(arrived)), impairment, mtu=mtu, seconds=seconds)
        os.close(writing)
        return [Arrival(*row) for row in _ROW.iter_unpack(file.read())]


def measure(
    impairment: Impairment, *, size: int, rate_hz: float, seconds: float, congestion: str, mtu: int
) -> list[Arrival]:
    """Send messages of `size` bytes at a rate for some seconds; return those that arrived."""
    return between_hosts(
        lambda: _send(size, rate_hz, seconds, congestion),
        lambda arrived: _receive(size, arrived),
        *(impairment, mtu, seconds + 2 * BEGIN_S),
    )


def _send(size: int, rate_hz: float, seconds: float, congestion: str) -> None:
    connection = _connected(congestion)
    body = bytes(size)
    begin = time.monotonic_ns()
    period = round(1e9 / rate_hz)
    due = 0
    while (now := time.monotonic_ns() - begin) < seconds * 1e9:
        if now < due * period:
            time.sleep((due * period - now) / 1e9)
            continue
        due = now // period  # what became due while the last one was written is dropped
        connection.sendall(_STAMP.pack(begin + due * period))
        connection.sendall(memoryview(body)[_STAMP.size :])
        due += 1


def _connected(congestion: str) -> socket.socket:
    end = time.monotonic() + 10.0
    while True:
        connection = socket.socket()
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, congestion.encode())
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            connection.connect((HOSTS[1], PORT))
            return connection
        except ConnectionRefusedError:
            connection.close()
            if time.monotonic() > end:
                raise
            time.sleep(0.01)


def _receive(size: int, arrived: OnArrival) -> None:
    with socket.create_server((HOSTS[1], PORT)) as server:
        connection, _ = server.accept()
    buffer = bytearray(size)
    while True:
        got = 0
        while got < size:
            more = connection.recv_into(memoryview(buffer)[got:])
            if not more:
                return
            got += more
        arrived(*_STAMP.unpack_from(buffer))
