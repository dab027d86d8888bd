# SPDX-License-Identifier: Apache-2.0
"""Bodies of RunCommand and RunCommandReply in Control (type 64), to the byte.

ROS controls a run by them. Each class packs and parses itself; commands are executed elsewhere.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

from .header import BadMessage, Buffer, Refused

_WISH = Struct("<BBxxIQ")
_ANSWER = Struct("<BB6xQq")

QUERY, PAUSE, RESUME, STEP, RESET = range(5)
"""What is wished; to ask is to wish nothing but the answer."""
STOPPED, RUNNING, PAUSED = range(3)
"""How a run is."""
ERROR_BYTES = 1024
"""Of the text of an answer, at most."""


class RunCommand(NamedTuple):
    """Kind 6: ROS wishes something of the run, until it is answered; topic and link are empty."""

    number: int
    """The wall clock in ns when it was made, or one more than the last one's. What has this number
    and comes from the same sender is the same wish, which is done once."""
    action: int = QUERY
    ticks: int = 0
    """How far to step; 0 for other wishes."""

    def pack(self) -> bytes:
        """Return the 16 bytes of the body.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        if not _is_wish(self):
            raise BadMessage(f"no peer would take {self}")
        return _WISH.pack(6, self.action, self.ticks, self.number)

    @classmethod
    def parse(cls, body: Buffer) -> RunCommand:
        """Return what the body says, or raise `Refused`."""
        if len(body) != _WISH.size:
            raise Refused("body_size")
        _, action, ticks, number = _WISH.unpack(body)
        wish = cls(number, action, ticks)
        if not _is_wish(wish):
            raise Refused("body_value")
        return wish


class RunCommandReply(NamedTuple):
    """Kind 7: what became of a wish; topic and link are empty."""

    number: int
    """The wish's."""
    state: int
    tick: int
    """The last one that was stepped to; -1 where there is no run."""
    error: str = ""
    """Why the wish could not be done; empty where it was."""

    def pack(self) -> bytes:
        """Return the body: 24 bytes and the error.

        Raises
        ------
        BadMessage
            When a field is out of its range.
        """
        error = self.error.encode()
        if not _is_answer(self) or len(error) > ERROR_BYTES:
            raise BadMessage(f"no peer would take {self}")
        return _ANSWER.pack(7, self.state, self.number, self.tick) + error

    @classmethod
    def parse(cls, body: Buffer) -> RunCommandReply:
        """Return what the body says, or raise `Refused`."""
        if not _ANSWER.size <= len(body) <= _ANSWER.size + ERROR_BYTES:
            raise Refused("body_size")
        _, state, number, tick = _ANSWER.unpack_from(body)
        try:
            answer = cls(number, state, tick, bytes(body)[_ANSWER.size :].decode())
        except UnicodeDecodeError:
            raise Refused("body_value") from None
        if not _is_answer(answer):
            raise Refused("body_value")
        return answer


def _is_wish(wish: RunCommand) -> bool:
    if wish.action == STEP:
        return 1 <= wish.ticks <= 0xFFFFFFFF
    return wish.action in (QUERY, PAUSE, RESUME, RESET) and wish.ticks == 0


def _is_answer(answer: RunCommandReply) -> bool:
    return (
        answer.state in range(STOPPED, PAUSED + 1)
        and answer.tick >= -1
        and "\0" not in answer.error
    )
