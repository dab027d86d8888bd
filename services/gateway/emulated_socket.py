# SPDX-License-Identifier: Apache-2.0
"""Socket wrapper that emulates an impaired link with the models of `groundlink.emulation`.

Two threads: one receives from the socket below, one sends delayed datagrams when they are due. A
datagram without a delay is sent at once by the caller's thread.
"""

import threading
import time
from collections import deque
from collections.abc import Sequence

import msgspec

from groundlink.core.clock import NANOS
from groundlink.emulation.model import DirectionState, LinkDirection
from groundlink.emulation.script import Changes, LinkScript, ScriptPlayer, parse_changes
from groundlink.emulation.settings import Impairment
from udp_bridge.io.socket_wrappers import SocketWrapper
from udp_bridge.io.udp_socket import DatagramSocket
from udp_bridge.io.worker_thread import ErrorCounter, WorkerThread
from udp_bridge.wire.header import Buffer, Refused

from .subscribers import Address

WAIT_SECONDS = 0.1
"""Longest time that a receiver waits."""

REFUSALS_KEPT = 1024
"""Refused datagrams that wait to be reported; with more, the receiving thread waits."""


class EmulatedSocket(SocketWrapper):
    """A socket whose datagrams pass an emulated link.

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
        """Apply the script's settings for an instant of simulation time."""
        with self._changing:
            self._set(self._script.at(sim_nanos / NANOS))

    def change(self, changes: dict[str, Changes]) -> None:
        """Change settings now, by direction and field.

        Raises
        ------
        ValueError
            when a direction or field does not exist, or a value is invalid.
        """
        with self._changing:
            self._script.change_all(changes)
            self._set(self._script.now())

    def answer(self, changes: str) -> list[bytes]:
        """Apply the changes of a query on the link's key; reply an error line and the settings."""
        error = ""
        try:
            self.change(parse_changes(changes))
        except ValueError as mistake:
            error = str(mistake)
        with self._changing:
            return [msgspec.json.encode((error, self._script.now()))]

    def counters(self) -> dict[str, int]:
        """Return the counters of both directions."""
        with self._outgoing, self._incoming:
            ways = {"to_ros": self._to_ros, "from_ros": self._from_ros}
            return {"link_errors": self._errors.count} | {
                f"link_{direction}_{name}": count
                for direction, way in ways.items()
                for name, count in (*way.counts.items(), ("waiting", way.waiting))
            }

    def direction_states(self) -> dict[str, DirectionState]:
        """Return the state of the random numbers, by direction."""
        with self._outgoing, self._incoming:
            return {"to_ros": self._to_ros.state, "from_ros": self._from_ros.state}

    def restore(self, states: dict[str, DirectionState]) -> None:
        """Continue the random numbers of an earlier link with the same script."""
        with self._outgoing, self._incoming:
            for direction, way in (("to_ros", self._to_ros), ("from_ros", self._from_ros)):
                if direction in states:
                    way.state = states[direction]

    def send(self, buffers: Sequence[Buffer], to: Address) -> bool:
        """Put a datagram into the link; return True, as its delivery is not known here."""
        with self._outgoing:
            self._to_ros.put(b"".join(buffers), to, time.monotonic_ns())
            self._send_due()
            self._outgoing.notify()
        return True

    def receive_into(self, buffer: bytearray) -> tuple[int, Address] | None:
        """Wait for a datagram that has passed the link."""
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
        """Wake every thread; datagrams in the link are dropped."""
        self._is_shut = True
        super().shut()
        for waiting in (self._outgoing, self._incoming):
            with waiting:
                waiting.notify_all()

    def close(self) -> None:
        """End the threads and close the socket."""
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
