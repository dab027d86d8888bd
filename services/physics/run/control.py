# SPDX-License-Identifier: Apache-2.0
"""Run control: takes commands from the bus's threads to the loop that steps.

A command waits until the loop executes it between two ticks; its sender waits for the answer. While
a run is restored it stands still, and commands that would change it are refused.
"""

import queue
from collections.abc import Callable
from concurrent.futures import Future
from typing import Protocol, TypeVar

import msgspec

from groundlink.core.errors import UserError
from groundlink.episode.control import (
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
"""Longest wait for an answer. A step takes milliseconds, but a reset or a change of a world with
hills takes seconds on a busy machine."""

LOADING_SECONDS = 25.0
"""Longest wait for an episode in another world: less than a gateway waits for physics' answer."""

T = TypeVar("T")


class ControlledRun(Protocol):
    """What run commands act on. Each method raises a UserError where it cannot."""

    def reset(self) -> None:
        """Start a new episode."""

    def change(self, command: Spawn | Remove) -> None:
        """Change the world."""

    def restore(self, content: bytes) -> None:
        """Start to restore a saved run from its file's content."""

    def refuse_without_world(self) -> None:
        """Refuse to go on while no world is loaded."""


class Control:
    """Whether time runs, and the queue of commands.

    Attributes
    ----------
    restoring_to
        see `ControlAnswer`; while it is set, no step may be taken.
    """

    def __init__(self, run: ControlledRun) -> None:
        self._run = run
        self._pending: queue.SimpleQueue[Callable[[], object]] = queue.SimpleQueue()
        self._ticks_left: int | None = None
        self.tick = -1
        self.restoring_to = -1
        self.warning = self.failure = ""

    @property
    def paused(self) -> bool:
        """Whether no step may be taken until a command says so."""
        return self._ticks_left == 0

    def pause(self) -> None:
        """Take no step until a command says so."""
        self._ticks_left = 0

    def stepped(self, tick: int) -> None:
        """Record a step."""
        self.tick = tick
        if self._ticks_left:
            self._ticks_left -= 1

    def answer(self, asked: str, content: bytes = b"") -> list[bytes]:
        """Execute a query's command, in JSON, or none; return a `ControlAnswer`."""
        error = ""
        if asked:
            try:
                command = msgspec.json.decode(asked, type=AnyRunCommand)
                self.between_ticks(lambda: self._execute(command, content))
            except (msgspec.DecodeError, UserError) as problem:
                error = str(problem)
        answer = ControlAnswer(
            *(error, self.tick, self.paused, self.restoring_to, self.warning, self.failure)
        )
        return [msgspec.json.encode(answer)]

    def between_ticks(self, do: Callable[[], T], *, seconds: float = ANSWER_SECONDS) -> T:
        """Have the loop call a function between two ticks; return what it returns.

        Parameters
        ----------
        seconds
            longest wait.

        Raises
        ------
        UserError
            when the function raises one, or the loop is busy for too long.
        """
        done: Future[T] = Future()

        def call() -> None:
            try:
                done.set_result(do())
            except UserError as problem:
                done.set_exception(problem)

        self._pending.put(call)
        try:
            return done.result(seconds)
        except TimeoutError:
            raise UserError(
                f"physics is busy for longer than {seconds:g} s, and executes the command "
                "later. Fix: ask for the run's status again"
            ) from None

    def execute_pending(self) -> None:
        """Execute all commands that have come; to be called between two ticks."""
        while not self._pending.empty():
            self._pending.get()()

    def refuse_while_restoring(self) -> None:
        """Refuse a change of a run that is being restored.

        Raises
        ------
        UserError
            while that goes on.
        """
        if self.restoring_to >= 0:
            raise UserError(
                f"the run is being restored, at tick {self.tick} of {self.restoring_to}. Fix: wait "
                "until that is done"
            )

    def _execute(self, command: AnyRunCommand, content: bytes) -> None:
        if isinstance(command, Reset | Spawn | Remove | Restore):
            self.refuse_while_restoring()
        if isinstance(command, Resume | Step | Reset | Spawn | Remove):
            self._run.refuse_without_world()
        match command:
            case Pause():
                self.pause()
            case Resume():
                self._ticks_left = None
            case Step(ticks=ticks):
                self._ticks_left = ticks
            case Reset():
                self._run.reset()
            case Spawn() | Remove():
                self._run.change(command)
            case Restore():
                self._run.restore(content)
