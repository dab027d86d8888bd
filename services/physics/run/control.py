# SPDX-License-Identifier: Apache-2.0
"""Wishes of people between the bus, where they arrive, and the loop that steps, which does them.

Rule: a wish waits until the loop takes it between two ticks; who asked waits for the answer. While
a run is restored it stands still, and what would change it is refused.
"""

from __future__ import annotations

import queue
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

import msgspec

from groundlink.core.errors import UserError
from groundlink.messages.control import (
    AnyRunCommand,
    ControlAnswer,
    Pause,
    Remove,
    Reset,
    Restore,
    Resume,
    Spawn,
    Step,
)

ANSWER_SECONDS = 6.0
"""How long who asks is kept waiting: a step of physics takes milliseconds, but a reset or a change
of a world with hills on a machine that has other work seconds."""


T = TypeVar("T")


class Control:
    """Whether time runs, and wishes that have come.

    Parameters
    ----------
    reset
        begins the run again.
    change
        changes the world, or raises a UserError that says why it cannot.
    restore
        begins to go on from a file's content, or raises a UserError that says why it cannot.
    """

    def __init__(
        self,
        reset: Callable[[], object],
        change: Callable[[Spawn | Remove], object],
        restore: Callable[[bytes], object],
    ) -> None:
        self._reset, self._change, self._restore = reset, change, restore
        self._waiting: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._ticks_left: int | None = None
        self.tick = -1
        self.restoring_to = -1
        """See `ControlAnswer`; while it is set, no step may be taken."""

        self.warning = self.failure = ""

    @property
    def paused(self) -> bool:
        """Whether people want no step to be taken."""
        return self._ticks_left == 0

    def pause(self) -> None:
        """Let no step be taken until people want it."""
        self._ticks_left = 0

    def stepped(self, tick: int) -> None:
        """Take note of a step."""
        self.tick = tick
        if self._ticks_left:
            self._ticks_left -= 1

    def answer(self, asked: str, content: bytes = b"") -> list[bytes]:
        """Do what a query says, a wish in JSON or nothing; reply a `ControlAnswer`."""
        error = ""
        if asked:
            try:
                wish = msgspec.json.decode(asked, type=AnyRunCommand)
                self.between_ticks(lambda: self._do(wish, content))
            except (msgspec.DecodeError, UserError) as problem:
                error = str(problem)
        answer = ControlAnswer(
            *(error, self.tick, self.paused, self.restoring_to, self.warning, self.failure)
        )
        return [msgspec.json.encode(answer)]

    def between_ticks(self, do: Callable[[], T]) -> T:
        """Have the loop do something between two ticks; return what it returns.

        Raises
        ------
        UserError
            when that raises one, or the loop has no time for it.
        """
        done: Future[T] = Future()

        def settle() -> None:
            try:
                done.set_result(do())
            except UserError as problem:
                done.set_exception(problem)

        self._waiting.put(settle)
        try:
            return done.result(ANSWER_SECONDS)
        except TimeoutError:
            raise UserError(
                f"physics is busy for longer than {ANSWER_SECONDS:g} s; ask again what became of it"
            ) from None

    def fulfil(self) -> None:
        """Do all that was wished; to be called between two ticks."""
        while not self._waiting.empty():
            self._waiting.get()()

    def _do(self, wish: AnyRunCommand, content: bytes) -> None:
        if self.restoring_to >= 0 and isinstance(wish, Reset | Spawn | Remove | Restore):
            raise UserError(
                f"the run is being restored, at tick {self.tick} of {self.restoring_to}; ask again "
                "when that is done"
            )
        match wish:
            case Pause():
                self.pause()
            case Resume():
                self._ticks_left = None
            case Step(ticks=ticks):
                self._ticks_left = ticks
            case Reset():
                self._reset()
            case Spawn() | Remove():
                self._change(wish)
            case Restore():
                self._restore(content)
