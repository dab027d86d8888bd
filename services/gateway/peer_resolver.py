# SPDX-License-Identifier: Apache-2.0
"""Where the peer is now, whose name may come to mean another address, or has none yet.

Rule: names are looked up on a thread of its own, since one failed look-up can take ten seconds, and
while it fails the last address holds.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from math import ceil

from groundlink.core.errors import UserError
from groundlink.process.runner import NoSuchHost

from .subscribers import Address

LOOK_UP_SECONDS = 2.0
"""Between two look-ups: a container that was made anew may have another address."""

WAIT_SECONDS = 0.02


class PeerResolver:
    """The address behind `HOST:PORT`.

    Parameters
    ----------
    look_up
        returns the address of such a text, or raises a UserError.
    """

    def __init__(
        self, text: str, look_up: Callable[[str], Address], period_seconds: float = LOOK_UP_SECONDS
    ) -> None:
        self.address: Address | None = None
        """The last one; None before the first."""

        self._text, self._look_up, self._period_seconds = text, look_up, period_seconds
        self._mistake: UserError | None = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._keep_looking, daemon=True)
        self._thread.start()

    def known(self, stop: threading.Event, tell: Callable[[str], object]) -> Address | None:
        """Return the address as soon as there is one, None if `stop` is set before.

        Parameters
        ----------
        tell
            is called once where that takes longer than the time between two look-ups.

        Raises
        ------
        UserError
            when the text is no address.
        """
        waits, patience = 0, ceil(self._period_seconds / WAIT_SECONDS)
        while self.address is None and not stop.wait(WAIT_SECONDS):
            if self._mistake is not None and not isinstance(self._mistake, NoSuchHost):
                raise self._mistake
            waits += 1
            if waits == patience:
                tell(
                    f"no address is known of `{self._text}`, which is looked up again and again; "
                    "ROS gets nothing until there is one"
                )
        return self.address

    def _keep_looking(self) -> None:
        while not self._end.is_set():
            try:
                self.address = self._look_up(self._text)
            except UserError as mistake:
                self._mistake = mistake
            self._end.wait(self._period_seconds)

    def close(self) -> None:
        """Look no more; a look-up under way ends with the process."""
        self._end.set()
