# SPDX-License-Identifier: Apache-2.0
"""Run commands from ROS: forwarded to physics one after the other, each executed once.

Rule: physics may take seconds to answer, so it is asked on a thread of this module's own, and
neither the bus nor the wire waits for it. A wish that comes again is one whose answer was lost, or
that is still under way: it is answered, not done.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable

from groundlink.core.errors import UserError
from groundlink.messages.control import AnyRunCommand, ControlAnswer, Pause, Reset, Resume, Step
from udp_bridge.wire.run_commands import (
    ERROR_BYTES,
    PAUSE,
    PAUSED,
    RESET,
    RESUME,
    RUNNING,
    STEP,
    STOPPED,
    RunCommand,
    RunCommandReply,
)

ANSWERS_KEPT = 256
"""Of these, answers are told again; a wish is repeated for seconds, and people are slow."""

WISHES_WAITING = 64
"""More are left to be repeated."""

BACKLOG_LOOKS = 500
"""So often, every millisecond, it is looked whether what physics has published before an answer was
sent: clocks go first."""

ON_THE_BUS: dict[int, AnyRunCommand] = {PAUSE: Pause(), RESUME: Resume(), RESET: Reset()}
"""What physics is told for each wish; for a step how far, and for a question nothing."""


class RunCommandQueue:
    """What ROS has wished, and what became of it.

    Parameters
    ----------
    ask
        returns physics' answer, or raises a UserError that says why there is none.
    backlog
        returns how many messages of the bus wait for being sent.
    """

    def __init__(
        self, ask: Callable[[AnyRunCommand | None], ControlAnswer], *, backlog: Callable[[], int]
    ) -> None:
        self._ask, self._backlog = ask, backlog
        self._tell: Callable[[RunCommandReply], object] | None = None
        self._is_over = threading.Event()
        self._waiting: queue.SimpleQueue[RunCommand | None] = queue.SimpleQueue()
        self._answers: dict[int, RunCommandReply | None] = {}
        """By number, from the moment on that a wish is taken."""

        self._thread = threading.Thread(target=self._run, name="wishes", daemon=True)
        self._thread.start()

    def tell_by(self, tell: Callable[[RunCommandReply], object]) -> None:
        """Say how the peer is told, from now on."""
        self._tell = tell

    def take(self, wish: RunCommand) -> None:
        """Take a wish of the peer; from the link's receiving thread, never blocks."""
        if wish.number in self._answers:
            answer = self._answers[wish.number]
            if answer is not None and self._tell is not None:
                self._tell(answer)
        elif self._waiting.qsize() < WISHES_WAITING:
            self._answers[wish.number] = None
            while len(self._answers) > ANSWERS_KEPT:
                del self._answers[next(iter(self._answers))]
            self._waiting.put(wish)

    def close(self) -> None:
        """End the thread when physics has answered; what waits is not done."""
        self._is_over.set()
        self._waiting.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (wish := self._waiting.get()) is not None and not self._is_over.is_set():
            answer = self._answers[wish.number] = self._answer(wish)
            if self._tell is not None:
                self._tell(answer)

    def _answer(self, wish: RunCommand) -> RunCommandReply:
        try:
            said = self._ask(
                Step(wish.ticks) if wish.action == STEP else ON_THE_BUS.get(wish.action)
            )
        except UserError as problem:
            error = str(problem).encode()[:ERROR_BYTES].decode(errors="ignore")
            return RunCommandReply(wish.number, STOPPED, -1, error)
        looks = 0
        while self._backlog() and looks < BACKLOG_LOOKS and not self._is_over.wait(0.001):
            looks += 1
        return RunCommandReply(wish.number, PAUSED if said.paused else RUNNING, said.tick)
