# SPDX-License-Identifier: Apache-2.0
"""When it has been quiet for so long that one asks whether something got lost.

Rule: time comes in as an argument.
"""

from __future__ import annotations

QUIET_SECONDS = 2.0
MOST_QUIET_SECONDS = 60.0


class Backoff:
    """Waits for `QUIET_SECONDS`, and after each time of asking for twice as long, to a limit.

    A run that people have paused is quiet, too, and nobody shall ask much of it.
    """

    def __init__(self, now_seconds: float) -> None:
        self.heard(now_seconds)

    def heard(self, now_seconds: float) -> None:
        """Begin anew: something came."""
        self._seconds, self._since = QUIET_SECONDS, now_seconds

    def is_too_long(self, now_seconds: float) -> bool:
        """Return whether to ask, once."""
        if now_seconds - self._since <= self._seconds:
            return False
        self._seconds, self._since = min(2 * self._seconds, MOST_QUIET_SECONDS), now_seconds
        return True
