# SPDX-License-Identifier: Apache-2.0
"""Run commands from ROS, translated to those of the bus."""

from collections.abc import Callable

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

BUS_COMMANDS: dict[int, AnyRunCommand] = {PAUSE: Pause(), RESUME: Resume(), RESET: Reset()}
"""By action of the wire: the command for physics. Steps have an argument, queries no command."""


def execute_run_command(
    execute: Callable[[AnyRunCommand | None], ControlAnswer], command: RunCommand
) -> RunCommandReply:
    """Execute a command of the peer; return the reply.

    Parameters
    ----------
    execute
        returns the answer of physics, or raises a UserError that says why there is none.
    """
    is_step = command.action == STEP
    try:
        answer = execute(Step(command.ticks) if is_step else BUS_COMMANDS.get(command.action))
    except UserError as problem:
        error = str(problem).encode()[:ERROR_BYTES].decode(errors="ignore")
        return RunCommandReply(command.number, STOPPED, -1, error)
    return RunCommandReply(command.number, PAUSED if answer.paused else RUNNING, answer.tick)
