# SPDX-License-Identifier: Apache-2.0
"""The link emulation around the gateway's socket; what it does is in `groundlink.emulation`.

Rule: the only place of the gateway where datagrams are lost, held up or spoilt on purpose. Two
threads: one takes from the socket below, one sends what is due. Where nothing is to be done to it,
a datagram goes out at once in the sender's thread.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Sequence

import msgspec

from groundlink.core.clock import NANOS
from groundlink.emulation import Impairment, LinkDirection, LinkScript, ScriptPlayer
from groundlink.emulation.model import DirectionState
from groundlink.emulation.script import Changes, parse_changes
from udp_bridge.io.socket_wrappers import Around
from udp_bridge.io.udp_socket import DatagramSocket
from udp_bridge.io.worker_thread import ErrorCounter, WorkerThread
from udp_bridge.wire.header import Buffer, Refused

from .subscribers import Address

WAIT_SECONDS = 0.1
"""How long a receiver waits at most."""

REFUSALS_KEPT = 1024
"""Refused datagrams that wait to be told; beyond it the socket below has to wait."""


class EmulatedSocket(Around):
    """A socket whose datagrams take an emulated link.

    Parameters
    ----------
    flips
        whether bit errors are delivered, see `LinkDirection`.
    """

    def __init__(self, inner: DatagramSocket, script: LinkScript, *, flips: bool) -> None:
        super().__init__(inner)
        self._script = ScriptPlayer(script)
        self._to_ros: LinkDirection[Address] = LinkDirection(
            script.to_ros, seed=script.seed, direction="to_ros", flips=flips
        )
        self._from_ros: LinkDirection[Address] = LinkDirection(
            script.from_ros, seed=script.seed, direction="from_ros", flips=flips
        )
        self._refused: deque[Refused] = deque()
        self._outgoing = threading.Condition()  # guards to_ros
        self._incoming = threading.Condition()  # guards from_ros and what was refused
        self._changing = threading.Lock()  # guards the script
        self._is_shut = False
        self._errors = ErrorCounter()
        self._buffer = bytearray(1 << 16)
        self._threads = [
            WorkerThread(f"link emulation {name}", turn, self._errors)
            for turn, name in ((self._send_turn, "send"), (self._receive_turn, "receive"))
        ]
        for thread in self._threads:
            thread.start()

    def at(self, sim_nanos: int) -> None:
        """Do what the script says for this instant of sim time."""
        with self._changing:
            self._set(self._script.at(sim_nanos / NANOS))

    def change(self, changes: dict[str, Changes]) -> None:
        """Change fields by direction, now.

        Raises
        ------
        ValueError
            when there is no such direction or field, or the value is none for it.
        """
        with self._changing:
            self._script.change_all(changes)
            self._set(self._script.now())

    def answer(self, wish: str) -> list[bytes]:
        """Do what a query on the link's key says; reply an error's line and the settings."""
        error = ""
        try:
            self.change(parse_changes(wish))
        except ValueError as mistake:
            error = str(mistake)
        with self._changing:
            return [msgspec.json.encode((error, self._script.now()))]

    def counters(self) -> dict[str, int]:
        """Return what the link did, by direction and name."""
        with self._outgoing, self._incoming:
            ways = {"to_ros": self._to_ros, "from_ros": self._from_ros}
            return {"link_errors": self._errors.count} | {
                f"link_{direction}_{name}": count
                for direction, way in ways.items()
                for name, count in (*way.counts.items(), ("waiting", way.waiting))
            }

    def courses(self) -> dict[str, DirectionState]:
        """Return by direction how far the link has come."""
        with self._outgoing, self._incoming:
            return {"to_ros": self._to_ros.course, "from_ros": self._from_ros.course}

    def take_up(self, courses: dict[str, DirectionState]) -> None:
        """Go on with the random numbers of an earlier link of the same script."""
        with self._outgoing, self._incoming:
            for direction, way in (("to_ros", self._to_ros), ("from_ros", self._from_ros)):
                if direction in courses:
                    way.course = courses[direction]

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Give a datagram to the link; whether it arrives is not known here."""
        with self._outgoing:
            self._to_ros.put(b"".join(buffers), to, time.monotonic_ns())
            self._send_due()
            self._outgoing.notify()
        return True

    def receive_into(self, buffer: bytearray) -> tuple[int, Address] | None:
        """Wait for a datagram that has come through the link."""
        until_nanos = time.monotonic_ns() + int(WAIT_SECONDS * NANOS)
        with self._incoming:
            while not self._is_shut:
                if self._refused:
                    self._incoming.notify_all()
                    raise self._refused.popleft()
                now_nanos = time.monotonic_ns()
                if taken := self._from_ros.take(now_nanos):
                    _, datagram, sender = taken
                    buffer[: len(datagram)] = datagram
                    return len(datagram), sender
                if now_nanos >= until_nanos:
                    break
                wake_nanos = min(until_nanos, self._from_ros.next_due() or until_nanos)
                self._incoming.wait((wake_nanos - now_nanos) / NANOS)
        return None

    def shut(self) -> None:
        """Wake every thread; what is on the way stays there."""
        self._is_shut = True
        super().shut()
        for waiting in (self._outgoing, self._incoming):
            with waiting:
                waiting.notify_all()

    def close(self) -> None:
        """End the threads and give the socket back."""
        self.shut()
        for thread in self._threads:
            thread.join()
        super().close()

    def _set(self, settings: dict[str, Impairment]) -> None:
        with self._outgoing:
            self._to_ros.settings = settings["to_ros"]
        with self._incoming:
            self._from_ros.settings = settings["from_ros"]

    def _send_due(self) -> None:
        while taken := self._to_ros.take(time.monotonic_ns()):
            self._inner.send([taken[1]], taken[2])

    def _send_turn(self) -> bool:
        with self._outgoing:
            if not self._is_shut:
                self._send_due()
                due_nanos = self._to_ros.next_due()
                if due_nanos is None:
                    self._outgoing.wait()
                else:
                    self._outgoing.wait(max(0, due_nanos - time.monotonic_ns()) / NANOS)
        return not self._is_shut

    def _receive_turn(self) -> bool:
        try:
            received = self._inner.receive_into(self._buffer)
        except Refused as refused:
            with self._incoming:
                self._refused.append(refused)
                self._incoming.notify_all()
                while len(self._refused) >= REFUSALS_KEPT and not self._is_shut:
                    self._incoming.wait()
        else:
            if received is not None:
                size, sender = received
                with self._incoming:
                    self._from_ros.put(bytes(self._buffer[:size]), sender, time.monotonic_ns())
                    self._incoming.notify_all()
        return not self._is_shut
