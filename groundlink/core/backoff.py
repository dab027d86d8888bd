# SPDX-License-Identifier: Apache-2.0
"""Backoff: when to ask again whether a message was lost. Time is an argument."""

FIRST_SECONDS = 2.0
MAX_SECONDS = 60.0


class Backoff:
    """Wait `FIRST_SECONDS` after the last message, then twice as long each time, up to a maximum.

    The maximum limits the load of a run that is paused on purpose.
    """

    def __init__(self, now_seconds: float) -> None:
        self.reset(now_seconds)

    def reset(self, now_seconds: float) -> None:
        """Start over: a message arrived."""
        self._seconds, self._since = FIRST_SECONDS, now_seconds

    def is_due(self, now_seconds: float) -> bool:
        """Return whether the wait is over. True starts the next, longer wait."""
        if now_seconds - self._since <= self._seconds:
            return False
        self._seconds, self._since = min(2 * self._seconds, MAX_SECONDS), now_seconds
        return True
