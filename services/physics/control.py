# SPDX-License-Identifier: Apache-2.0
"""Wishes of people between the bus, where they arrive, and the loop that steps, which does them.

Rule: a wish waits until the loop takes it between two ticks; who asked waits for the answer.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from concurrent.futures import Future

import msgspec

from groundlink.control import (
    AnyWish,
    ControlAnswer,
    Pause,
    Remove,
    Reset,
    Resume,
    Spawn,
    Step,
)
from groundlink.errors import UserError

ANSWER_SECONDS = 2.0
"""How long who asks is kept waiting: a step of physics takes milliseconds, a reset somewhat longer.
"""


class Control:
    """Whether time runs, and wishes that have come.

    Parameters
    ----------
    reset
        begins the run again.
    change
        changes the world, or raises a UserError that says why it cannot.
    """

    def __init__(
        self, reset: Callable[[], object], change: Callable[[Spawn | Remove], object]
    ) -> None:
        self._reset, self._change = reset, change
        self._wishes: queue.SimpleQueue[tuple[AnyWish, Future[None]]] = queue.SimpleQueue()
        self._ticks_left: int | None = None
        self.tick = -1

    @property
    def paused(self) -> bool:
        """Whether no step may be taken."""
        return self._ticks_left == 0

    def stepped(self, tick: int) -> None:
        """Take note of a step."""
        self.tick = tick
        if self._ticks_left:
            self._ticks_left -= 1

    def answer(self, asked: str) -> list[bytes]:
        """Do what a query says, a wish in JSON or nothing; reply a `ControlAnswer`."""
        error = ""
        if asked:
            done: Future[None] = Future()
            try:
                self._wishes.put((msgspec.json.decode(asked, type=AnyWish), done))
                done.result(ANSWER_SECONDS)
            except msgspec.DecodeError as problem:
                error = str(problem)
            except UserError as problem:
                error = str(problem)
            except TimeoutError:
                error = "physics is busy; ask again what became of it"
        return [msgspec.json.encode(ControlAnswer(error, self.tick, self.paused))]

    def fulfil(self) -> None:
        """Do all that was wished; to be called between two ticks."""
        while not self._wishes.empty():
            wish, done = self._wishes.get()
            match wish:
                case Pause():
                    self._ticks_left = 0
                case Resume():
                    self._ticks_left = None
                case Step(ticks=ticks):
                    self._ticks_left = ticks
                case Reset():
                    self._reset()
                case Spawn() | Remove():
                    try:
                        self._change(wish)
                    except UserError as problem:
                        done.set_exception(problem)
                        continue
            done.set_result(None)
