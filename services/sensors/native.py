# SPDX-License-Identifier: Apache-2.0
"""What a device itself would send, by UDP, beside its readings on the bus.

Rule: datagrams come ready made from the model; they go out as readings are published, and are never
waited for, repeated or answered. Who does not listen changes nothing.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable

from groundlink.process import address


class NativeLink:
    """Where a device's own datagrams go.

    Raises
    ------
    UserError
        when `destination` is no HOST:PORT.
    """

    def __init__(self, destination: str) -> None:
        self._destination = address(destination)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.sent = 0
        self.unsent = 0

    def send(self, datagrams: Iterable[bytes]) -> None:
        """Send each datagram; what the system does not take is counted as `unsent`."""
        for datagram in datagrams:
            try:
                self._socket.sendto(datagram, self._destination)
                self.sent += 1
            except OSError:
                self.unsent += 1

    def close(self) -> None:
        """Send no more."""
        self._socket.close()
