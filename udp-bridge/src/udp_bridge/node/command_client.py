# SPDX-License-Identifier: Apache-2.0
"""Client of run commands: sends a command to the gateway until the gateway replies.

A command keeps its number when it is repeated, so the gateway executes it once. Within `TIMEOUT_S`
every call returns a reply or raises `CommandFailed`.
"""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue
from typing import Callable, Dict, List, Tuple

from udp_bridge.wire.message import Address
from udp_bridge.wire.run_commands import RunCommand, RunCommandReply

REPEAT_S = 0.1
"""A command is repeated when no reply came for so long; either datagram may be lost."""
TIMEOUT_S = 8.0
"""Longer than the 7 s that a gateway waits for physics, so that the gateway can report that."""
PRESENT_NANOS = 5_000_000_000
"""A gateway subscribes once a second. After such a silence it may have ended, and commands go to
it only when no other gateway is present."""
MAX_GATEWAYS = 64
"""Bounds the memory that unknown senders can take."""
DISCOVERY_S = 2.0
"""How long a node that was just started waits for a gateway."""


class CommandFailed(Exception):
    """A command was not executed; the text says why."""


class RunCommandClient:
    """Sends commands to the gateway that subscribes here; several threads may call at a time.

    Parameters
    ----------
    send
        Called with a command and its destination.
    timeout_s
        How long a gateway may be silent.
    now_nanos
        A monotonic clock.
    """

    def __init__(
        self,
        send: Callable[[RunCommand, Address], object],
        *,
        timeout_s: float = TIMEOUT_S,
        now_nanos: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._send = send
        self._timeout_s = timeout_s
        self._now_nanos = now_nanos
        self._seen_nanos: Dict[Address, int] = {}
        self._number = 0
        self._numbering = threading.Lock()
        self._pending: Dict[Tuple[int, Address], SimpleQueue[RunCommandReply]] = {}
        self._is_closed = False

    def gateway_seen(self, gateway: Address) -> None:
        """Note that a gateway is present; from any thread, never blocks."""
        now_nanos = self._now_nanos()
        if gateway not in self._seen_nanos:
            self._seen_nanos = dict(self._present(now_nanos)[: MAX_GATEWAYS - 1])
        self._seen_nanos[gateway] = now_nanos

    def reply_received(self, reply: RunCommandReply, sender: Address) -> None:
        """Pass a reply to the thread that waits for it; from any thread, never blocks."""
        if pending := self._pending.get((reply.number, sender)):
            pending.put(reply)

    def call(self, action: int, ticks: int = 0) -> RunCommandReply:
        """Send a command and return the gateway's reply.

        Raises
        ------
        CommandFailed
            When there is no gateway, or it does not reply, or the command was not executed.
        """
        gateway = self._gateway()
        with self._numbering:
            # The wall clock makes numbers differ from those of a node that ran before.
            self._number = max(self._number + 1, time.time_ns())
            command = RunCommand(self._number, action, ticks)
        pending = self._pending[command.number, gateway] = SimpleQueue()
        try:
            reply = self._reply(command, gateway, pending)
        finally:
            del self._pending[command.number, gateway]
        if reply.error:
            raise CommandFailed(reply.error)
        return reply

    def close(self) -> None:
        """Make all waiting calls fail."""
        self._is_closed = True

    def _reply(
        self, command: RunCommand, gateway: Address, pending: SimpleQueue[RunCommandReply]
    ) -> RunCommandReply:
        for _ in range(round(self._timeout_s / REPEAT_S)):
            if self._is_closed:
                raise CommandFailed("the bridge is ending")
            self._send(command, gateway)
            try:
                return pending.get(timeout=REPEAT_S)
            except Empty:
                pass
        raise CommandFailed(f"the gateway at {_text(gateway)} was silent for {self._timeout_s:g} s")

    def _gateway(self) -> Address:
        for _ in range(round(DISCOVERY_S / REPEAT_S)):
            if self._seen_nanos or self._is_closed:
                break
            time.sleep(REPEAT_S)
        else:
            raise CommandFailed(
                "no gateway found. Fix: start the run, and check that its gateway sends here"
            )
        present = [address for address, _ in self._present(self._now_nanos())]
        if len(present) > 1:
            raise CommandFailed(
                f"several gateways: {', '.join(map(_text, sorted(present)))}. "
                "Fix: name one with the parameter `peer`"
            )
        if present:
            return present[0]
        if not self._seen_nanos:
            raise CommandFailed("the bridge is ending")
        return max(list(self._seen_nanos.items()), key=lambda row: row[1])[0]

    def _present(self, now_nanos: int) -> List[Tuple[Address, int]]:
        seen = list(self._seen_nanos.items())
        return [(address, when) for address, when in seen if now_nanos - when < PRESENT_NANOS]


def _text(address: Address) -> str:
    return f"{address[0]}:{address[1]}"
