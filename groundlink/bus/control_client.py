# SPDX-License-Identifier: Apache-2.0
"""How a run's physics is told a wish, by whoever is on the bus.

Rule: one query, one answer; what may be wished is in `control`.
"""

from __future__ import annotations

import msgspec

from groundlink.core.errors import UserError
from groundlink.messages.control import AnyRunCommand, ControlAnswer

from .queries import control_key
from .session import Bus

ANSWER_SECONDS = 7.0
"""How long physics may be silent; it answers within 6 s what it has no time for."""


def ask(
    bus: Bus, run: str, wish: AnyRunCommand | None = None, *, content: bytes | None = None
) -> ControlAnswer:
    """Return physics' answer to a wish, with what comes with it, or how it is.

    Raises
    ------
    UserError
        when there is none, or the wish could not be done.
    """
    asked = msgspec.json.encode(wish).decode() if wish is not None else ""
    replies = bus.ask(control_key(run), asked, seconds=ANSWER_SECONDS, content=content)
    if not replies:
        raise UserError(f"physics of run `{run}` does not answer; is its process running?")
    answer = msgspec.json.decode(next(iter(replies.values())), type=ControlAnswer)
    if answer.error:
        raise UserError(f"run `{run}`: {answer.error}")
    return answer
