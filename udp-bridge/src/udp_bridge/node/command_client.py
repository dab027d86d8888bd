# SPDX-License-Identifier: Apache-2.0
"""Client of run commands and world queries: repeats a request until the gateway replies.

A request keeps its number when it is repeated, so the gateway executes it once. Within `TIMEOUT_S`,
or `QUERY_TIMEOUT_S`, every call returns a reply or raises `CommandFailed`.
"""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue
from typing import Any, Callable, Dict, List, Tuple, Type, TypeVar, Union

from udp_bridge.wire.header import BadMessage, Refused
from udp_bridge.wire.message import Address
from udp_bridge.wire.run_commands import RunCommand, RunCommandReply
from udp_bridge.wire.world_queries import WorldQuery, WorldReply, pack_text, unpack_text

REPEAT_S = 0.1
"""A request is repeated when no reply came for so long; either datagram may be lost."""
TIMEOUT_S = 8.0
"""Longer than the 7 s that a gateway waits for physics, so that the gateway can report that."""
QUERY_TIMEOUT_S = 31.0
"""Longer than the 30 s that a gateway waits for physics, which may load a world."""
PRESENT_NANOS = 5_000_000_000
"""A gateway subscribes once a second. After such a silence it may have ended, and commands go to
it only when no other gateway is present."""
MAX_GATEWAYS = 64
"""Bounds the memory that unknown senders can take."""
DISCOVERY_S = 2.0
"""How long a node that was just started waits for a gateway."""

GatewayRequest = Union[RunCommand, WorldQuery]
GatewayReply = Union[RunCommandReply, WorldReply]
_ReplyT = TypeVar("_ReplyT", RunCommandReply, WorldReply)


class CommandFailed(Exception):
    """A command was not executed; the text says why."""


class RunCommandClient:
    """Sends requests to the gateway that subscribes here; several threads may call at a time.

    Parameters
    ----------
    send
        Called with a request and its destination.
    timeout_s, query_timeout_s
        How long a gateway may be silent after a command, and after a query.
    now_nanos
        A monotonic clock.
    """

    def __init__(
        self,
        send: Callable[[GatewayRequest, Address], object],
        *,
        timeout_s: float = TIMEOUT_S,
        query_timeout_s: float = QUERY_TIMEOUT_S,
        now_nanos: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._send = send
        self._timeout_s, self._query_timeout_s = timeout_s, query_timeout_s
        self._now_nanos = now_nanos
        self._seen_nanos: Dict[Address, int] = {}
        self._number = 0
        self._numbering = threading.Lock()
        self._pending: Dict[Tuple[Type[GatewayReply], int, Address], SimpleQueue[Any]] = {}
        self._is_closed = False

    def gateway_seen(self, gateway: Address) -> None:
        """Note that a gateway is present; from any thread, never blocks."""
        now_nanos = self._now_nanos()
        if gateway not in self._seen_nanos:
            self._seen_nanos = dict(self._present(now_nanos)[: MAX_GATEWAYS - 1])
        self._seen_nanos[gateway] = now_nanos

    def reply_received(self, reply: GatewayReply, sender: Address) -> None:
        """Pass a reply to the thread that waits for it; from any thread, never blocks."""
        if pending := self._pending.get((type(reply), reply.number, sender)):
            pending.put(reply)

    def call(self, action: int, ticks: int = 0) -> RunCommandReply:
        """Send a command and return the gateway's reply.

        Raises
        ------
        CommandFailed
            When there is no gateway, or it does not reply, or the command was not executed.
        """
        reply = self._exchange(
            lambda number: RunCommand(number, action, ticks), RunCommandReply, self._timeout_s
        )
        if reply.error:
            raise CommandFailed(reply.error)
        return reply

    def ask(self, text: str) -> str:
        """Send a world query and return the answer, which may be an error of its own.

        Raises
        ------
        CommandFailed
            When there is no gateway, or it does not reply, or a text is too large.
        """
        try:
            packed = pack_text(text)
        except BadMessage as problem:
            raise CommandFailed(f"the query can't be sent: {problem}") from None
        reply = self._exchange(
            lambda number: WorldQuery(number, packed),
            WorldReply,
            self._query_timeout_s,
            "; one of an older version does not answer world queries. Fix: update it, or check "
            "its log",
        )
        try:
            return unpack_text(reply.packed_text)
        except Refused as refused:
            raise CommandFailed(f"the gateway's answer can't be read: {refused.reason}") from None

    def close(self) -> None:
        """Make all waiting calls fail."""
        self._is_closed = True

    def _exchange(
        self,
        request_of: Callable[[int], GatewayRequest],
        reply_type: Type[_ReplyT],
        timeout_s: float,
        hint: str = "",
    ) -> _ReplyT:
        """Send the request with the next number until a reply of a type comes; return that."""
        gateway = self._gateway()
        with self._numbering:
            # The wall clock makes numbers differ from those of a node that ran before.
            number = self._number = max(self._number + 1, time.time_ns())
        request = request_of(number)
        pending: SimpleQueue[_ReplyT] = SimpleQueue()
        self._pending[reply_type, number, gateway] = pending
        try:
            for _ in range(round(timeout_s / REPEAT_S)):
                if self._is_closed:
                    raise CommandFailed("the bridge is ending")
                self._send(request, gateway)
                try:
                    return pending.get(timeout=REPEAT_S)
                except Empty:
                    pass
        finally:
            del self._pending[reply_type, number, gateway]
        raise CommandFailed(f"the gateway at {_text(gateway)} was silent for {timeout_s:g} s{hint}")

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
