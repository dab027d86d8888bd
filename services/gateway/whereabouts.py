# SPDX-License-Identifier: Apache-2.0
"""Where the peer is now, whose name may come to mean another address.

Rule: names are looked up on a thread of its own, since one failed look-up can take ten seconds, and
while it fails the last address holds.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from groundlink.errors import UserError

from .subscriptions import Address

LOOK_UP_SECONDS = 2.0
"""Between two look-ups: a container that was made anew may have another address."""


class Whereabouts:
    """The address behind `HOST:PORT`.

    Parameters
    ----------
    look_up
        returns the address of such a text, or raises a UserError.

    Raises
    ------
    UserError
        when it has none at first.
    """

    def __init__(
        self, text: str, look_up: Callable[[str], Address], period_seconds: float = LOOK_UP_SECONDS
    ) -> None:
        self.address = look_up(text)
        self._text, self._look_up, self._period_seconds = text, look_up, period_seconds
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._keep_looking, daemon=True)
        self._thread.start()

    def _keep_looking(self) -> None:
        while not self._end.wait(self._period_seconds):
            try:
                self.address = self._look_up(self._text)
            except UserError:
                continue

    def close(self) -> None:
        """Look no more; a look-up under way ends with the process."""
        self._end.set()
