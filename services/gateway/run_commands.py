# SPDX-License-Identifier: Apache-2.0
"""Run commands from ROS: sent to physics one after the other, each executed once.

Physics may take seconds to answer, so a thread of its own waits for it. A command that arrives
again was not answered yet, or its reply was lost: it is answered again and not executed again.
"""

import queue
import threading
from collections.abc import Callable, Sized

from groundlink.core.errors import UserError
from groundlink.episode.control import AnyRunCommand, ControlAnswer, Pause, Reset, Resume, Step
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

REPLIES_KEPT = 256
"""Replies that can be sent again; a command is repeated for some seconds."""

COMMANDS_WAITING = 64
"""Further commands are dropped; the peer repeats them."""

BACKLOG_CHECKS = 500
"""Most checks, one each millisecond, whether the messages that physics published before its answer
were sent. The reply follows them."""

BUS_COMMANDS: dict[int, AnyRunCommand] = {PAUSE: Pause(), RESUME: Resume(), RESET: Reset()}
"""By action of the wire: the command for physics. Steps have an argument, queries no command."""


class RunCommandQueue:
    """Commands that were received, and their replies.

    Parameters
    ----------
    execute
        returns the answer of physics, or raises a UserError that says why there is none.
    backlog
        messages of the bus that wait to be sent.
    """

    def __init__(
        self, execute: Callable[[AnyRunCommand | None], ControlAnswer], *, backlog: Sized
    ) -> None:
        self._execute, self._backlog = execute, backlog
        self._send: Callable[[RunCommandReply], object] | None = None
        self._is_over = threading.Event()
        self._waiting: queue.SimpleQueue[RunCommand | None] = queue.SimpleQueue()
        self._replies: dict[int, RunCommandReply | None] = {}
        """By the command's number; None while it is executed."""

        self._thread = threading.Thread(target=self._run, name="run commands", daemon=True)
        self._thread.start()

    def reply_with(self, send: Callable[[RunCommandReply], object]) -> None:
        """Set the function that sends replies to the peer."""
        self._send = send

    def put(self, command: RunCommand) -> None:
        """Take a command of the peer; called on the link's receive thread, never blocks."""
        if command.number in self._replies:
            reply = self._replies[command.number]
            if reply is not None and self._send is not None:
                self._send(reply)
        elif self._waiting.qsize() < COMMANDS_WAITING:
            self._replies[command.number] = None
            while len(self._replies) > REPLIES_KEPT:
                del self._replies[next(iter(self._replies))]
            self._waiting.put(command)

    def close(self) -> None:
        """End the thread after the present command; drop those that wait."""
        self._is_over.set()
        self._waiting.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (command := self._waiting.get()) is not None and not self._is_over.is_set():
            reply = self._replies[command.number] = self._executed(command)
            if self._send is not None:
                self._send(reply)

    def _executed(self, command: RunCommand) -> RunCommandReply:
        is_step = command.action == STEP
        try:
            answer = self._execute(
                Step(command.ticks) if is_step else BUS_COMMANDS.get(command.action)
            )
        except UserError as problem:
            error = str(problem).encode()[:ERROR_BYTES].decode(errors="ignore")
            return RunCommandReply(command.number, STOPPED, -1, error)
        checks = 0
        while len(self._backlog) and checks < BACKLOG_CHECKS and not self._is_over.wait(0.001):
            checks += 1
        return RunCommandReply(command.number, PAUSED if answer.paused else RUNNING, answer.tick)
