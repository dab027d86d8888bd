# SPDX-License-Identifier: Apache-2.0
"""Peer resolver: keeps the IP address of the peer's host name up to date.

A thread of its own looks the name up, since a failing look-up can take ten seconds. While look-ups
fail, the last known address stays in use.
"""

import threading
from collections.abc import Callable
from math import ceil

from groundlink.core.errors import UserError
from groundlink.process.runner import NoSuchHost

from .subscribers import Address

PERIOD_SECONDS = 2.0
"""Between two look-ups: a container that was created again may have another address."""

WAIT_SECONDS = 0.02


class PeerResolver:
    """The address behind `HOST:PORT`.

    Parameters
    ----------
    look_up
        returns the address of such a text, or raises a UserError.
    """

    def __init__(
        self, text: str, look_up: Callable[[str], Address], period_seconds: float = PERIOD_SECONDS
    ) -> None:
        self.address: Address | None = None
        """The last known address; None before the first."""

        self._text, self._look_up, self._period_seconds = text, look_up, period_seconds
        self._error: UserError | None = None
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="peer resolver", daemon=True)
        self._thread.start()

    def wait(self, stop: threading.Event, say: Callable[[str], object]) -> Address | None:
        """Wait for an address and return it; None if `stop` is set before.

        Parameters
        ----------
        say
            prints a line; called once if the wait is longer than the time between two look-ups.

        Raises
        ------
        UserError
            when the text is not an address.
        """
        waits, most_waits = 0, ceil(self._period_seconds / WAIT_SECONDS)
        while self.address is None and not stop.wait(WAIT_SECONDS):
            if self._error is not None and not isinstance(self._error, NoSuchHost):
                raise self._error
            waits += 1
            if waits == most_waits:
                say(f"`{self._text}` has no address yet; retrying, ROS gets nothing until then")
        return self.address

    def _run(self) -> None:
        while not self._closed.is_set():
            try:
                self.address = self._look_up(self._text)
            except UserError as error:
                self._error = error
            self._closed.wait(self._period_seconds)

    def close(self) -> None:
        """Stop looking up; a look-up in progress ends with the process."""
        self._closed.set()
