# SPDX-License-Identifier: Apache-2.0
"""Bodies of RunCommand and RunCommandReply in Control (type 64), to the byte.

ROS controls a run by them. Each class packs and parses itself; commands are executed elsewhere.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

from .header import BadMessage, Buffer, Refused

_COMMAND = Struct("<BBxxIQ")
_REPLY = Struct("<BB6xQq")

QUERY, PAUSE, RESUME, STEP, RESET = range(5)
"""Actions; a query only requests a reply."""
STOPPED, RUNNING, PAUSED = range(3)
"""States of a run."""
ERROR_BYTES = 1024
"""Bytes of the error in a reply, at most."""


class RunCommand(NamedTuple):
    """Kind 6: a command to the run, repeated until it is answered; topic and link are empty."""

    number: int
    """The sender's wall clock in ns, or one more than the last number. A command with this number
    from the same sender is a repetition, and is executed once."""
    action: int = QUERY
    ticks: int = 0
    """Ticks to step; 0 with other actions."""

    def pack(self) -> bytes:
        """Return the 16 bytes of the body.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if not _is_valid_command(self):
            raise BadMessage(f"a field is out of its range: {self}")
        return _COMMAND.pack(6, self.action, self.ticks, self.number)

    @classmethod
    def parse(cls, body: Buffer) -> RunCommand:
        """Return the parsed body, or raise `Refused`."""
        if len(body) != _COMMAND.size:
            raise Refused("body_size")
        _, action, ticks, number = _COMMAND.unpack(body)
        command = cls(number, action, ticks)
        if not _is_valid_command(command):
            raise Refused("body_value")
        return command


class RunCommandReply(NamedTuple):
    """Kind 7: the result of a command; topic and link are empty."""

    number: int
    """The command's."""
    state: int
    tick: int
    """The last tick of the run; -1 when there is none."""
    error: str = ""
    """Why the command was not executed; empty if it was."""

    def pack(self) -> bytes:
        """Return the body: 24 bytes and the error.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        error = self.error.encode()
        if not _is_valid_reply(self) or len(error) > ERROR_BYTES:
            raise BadMessage(f"a field is out of its range: {self}")
        return _REPLY.pack(7, self.state, self.number, self.tick) + error

    @classmethod
    def parse(cls, body: Buffer) -> RunCommandReply:
        """Return the parsed body, or raise `Refused`."""
        if not _REPLY.size <= len(body) <= _REPLY.size + ERROR_BYTES:
            raise Refused("body_size")
        _, state, number, tick = _REPLY.unpack_from(body)
        try:
            reply = cls(number, state, tick, bytes(body)[_REPLY.size :].decode())
        except UnicodeDecodeError:
            raise Refused("body_value") from None
        if not _is_valid_reply(reply):
            raise Refused("body_value")
        return reply


def _is_valid_command(command: RunCommand) -> bool:
    if command.action == STEP:
        return 1 <= command.ticks <= 0xFFFFFFFF
    return command.action in (QUERY, PAUSE, RESUME, RESET) and command.ticks == 0


def _is_valid_reply(reply: RunCommandReply) -> bool:
    return (
        reply.state in range(STOPPED, PAUSED + 1) and reply.tick >= -1 and "\0" not in reply.error
    )
