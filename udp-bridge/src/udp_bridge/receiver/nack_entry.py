# SPDX-License-Identifier: Apache-2.0
"""A message that has a gap: what was asked for of it, and when that is to be done again.

When to ask at all is `resend_asking`'s.
"""

from __future__ import annotations

from typing import Dict, Optional, Tuple

Due = Tuple[int, int]
"""When to ask for a part, and how often that was done. Alike for those asked for together."""


class Want:
    """What is known of such a message."""

    __slots__ = (
        "answered",
        "asked_nanos",
        "due",
        "highest",
        "is_asked",
        "since_nanos",
    )

    def __init__(self, since_nanos: int) -> None:
        self.since_nanos = since_nanos
        """When its first part, or the gap, was noticed."""
        self.due: Dict[int, Due] = {}
        """By part, those that are missing."""
        self.highest = -1
        """All parts up to this one have been sent."""
        self.asked_nanos = 0
        self.is_asked = False
        self.answered: Optional[Due] = None
        """What `due` said of the part that came last of those that were asked for."""

    def lost_again(self, part: int, due_nanos: int) -> bool:
        """Put the parts forward that were asked for with one that came and lie before it.

        They were sent before it, so they were lost once more, unless it overtook them (RFC 8985).
        Returns whether there are any.
        """
        answered = self.due.get(part)
        if answered is None or not answered[1]:
            return False
        self.answered = answered
        found = [other for other, due in self.due.items() if due == answered and other < part]
        if due_nanos < answered[0]:
            self.due.update(dict.fromkeys(found, (due_nanos, answered[1])))
        return bool(found)

    def offered(self, now_nanos: int, usual_nanos: int) -> None:
        """Put forward what an offer shows to be lost.

        It was sent behind all that had been asked for until then. Whether our request was in time
        is known by what came of it, or by a round trip that is over: `usual_nanos`, 0 where that
        is not known.
        """
        is_over = bool(usual_nanos) and now_nanos - self.asked_nanos >= usual_nanos
        for part, due in self.due.items():
            tries = due[1]
            if not tries or due == self.answered or (tries == 1 and is_over):
                self.due[part] = (now_nanos, tries)
