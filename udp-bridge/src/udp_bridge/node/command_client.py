# SPDX-License-Identifier: Apache-2.0
"""Wishes about a run's time, each sent again until the gateway answers it, or given up.

Rule: whoever asks gets an answer or an `CommandFailed` that says who is silent, within
`PATIENCE_S`. A wish keeps its number when it is sent again, so the gateway does it once. It knows
no ROS.
"""

from __future__ import annotations

import threading
import time
from queue import Empty, SimpleQueue
from typing import Callable, Dict, List, Tuple

from udp_bridge.wire.message import Address
from udp_bridge.wire.run_commands import RunCommand, RunCommandReply

REPEAT_S = 0.1
"""How long an answer may take before the wish is sent again: one of the two may be lost."""
PATIENCE_S = 8.0
"""How long a gateway may be silent. It gives physics 7 s, and tells when that is silent."""
HEARD_NANOS = 5_000_000_000
"""A gateway tells once a second what it wants of ROS. One that was silent for longer may be gone,
and is asked only where no other is there."""
MAX_GATEWAYS = 64
"""More are not looked at: strangers must not fill the memory."""
MEETING_S = 2.0
"""How long a node that has just begun listens for a gateway."""


class CommandFailed(Exception):
    """A wish was not done; the text says why."""


class RunCommandClient:
    """Asks the gateway whose wishes for topics arrive; from any thread, several at a time.

    Parameters
    ----------
    send
        Called with a wish and where to send it.
    patience_s
        How long a gateway may be silent.
    now_nanos
        A clock that never goes back.
    """

    def __init__(
        self,
        send: Callable[[RunCommand, Address], object],
        *,
        patience_s: float = PATIENCE_S,
        now_nanos: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._send = send
        self._patience_s = patience_s
        self._now_nanos = now_nanos
        self._heard: Dict[Address, int] = {}
        self._number = 0
        self._numbering = threading.Lock()
        self._waiting: Dict[Tuple[int, Address], SimpleQueue[RunCommandReply]] = {}
        self._is_closed = False

    def heard(self, gateway: Address) -> None:
        """Take note of a gateway that is there; from any thread, never blocks."""
        now_nanos = self._now_nanos()
        if gateway not in self._heard:
            self._heard = dict(self._present(now_nanos)[: MAX_GATEWAYS - 1])
        self._heard[gateway] = now_nanos

    def answered(self, answer: RunCommandReply, sender: Address) -> None:
        """Hand an answer to who waits for it; from any thread, never blocks."""
        if waiting := self._waiting.get((answer.number, sender)):
            waiting.put(answer)

    def ask(self, action: int, ticks: int = 0) -> RunCommandReply:
        """Return what the gateway answers to a wish.

        Raises
        ------
        CommandFailed
            When there is no gateway, or it is silent, or the wish could not be done.
        """
        gateway = self._gateway()
        with self._numbering:
            # So it differs from those of a node that was there before.
            self._number = max(self._number + 1, time.time_ns())
            wish = RunCommand(self._number, action, ticks)
        waiting = self._waiting[wish.number, gateway] = SimpleQueue()
        try:
            answer = self._answer(wish, gateway, waiting)
        finally:
            del self._waiting[wish.number, gateway]
        if answer.error:
            raise CommandFailed(answer.error)
        return answer

    def close(self) -> None:
        """Let nobody wait any longer."""
        self._is_closed = True

    def _answer(
        self, wish: RunCommand, gateway: Address, waiting: SimpleQueue[RunCommandReply]
    ) -> RunCommandReply:
        for _ in range(round(self._patience_s / REPEAT_S)):
            if self._is_closed:
                raise CommandFailed("the bridge is ending")
            self._send(wish, gateway)
            try:
                return waiting.get(timeout=REPEAT_S)
            except Empty:
                pass
        raise CommandFailed(
            f"the gateway at {_text(gateway)} was silent for {self._patience_s:g} s"
        )

    def _gateway(self) -> Address:
        for _ in range(round(MEETING_S / REPEAT_S)):
            if self._heard or self._is_closed:
                break
            time.sleep(REPEAT_S)
        else:
            raise CommandFailed(
                "no gateway was heard yet; is its run under way, and does it send here?"
            )
        present = [who for who, _ in self._present(self._now_nanos())]
        if len(present) > 1:
            raise CommandFailed(
                f"gateways are heard at {', '.join(map(_text, sorted(present)))}; "
                "name one by the parameter `peer`"
            )
        if present:
            return present[0]
        if not self._heard:
            raise CommandFailed("the bridge is ending")
        return max(list(self._heard.items()), key=lambda row: row[1])[0]

    def _present(self, now_nanos: int) -> List[Tuple[Address, int]]:
        heard = list(self._heard.items())
        return [(who, when) for who, when in heard if now_nanos - when < HEARD_NANOS]


def _text(address: Address) -> str:
    return f"{address[0]}:{address[1]}"
