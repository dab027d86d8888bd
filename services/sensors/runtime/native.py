# SPDX-License-Identifier: Apache-2.0
"""What a device itself would send, by UDP, beside its readings on the bus.

Rule: datagrams come ready made from the device; they go out as readings are published, and are
never waited for, repeated or answered. Who does not listen changes nothing.
"""

from __future__ import annotations

import socket
from typing import Any

from groundlink.process.runner import address

from .model import NativeDevice


class NativeLink:
    """A device, and where its own datagrams go.

    Raises
    ------
    UserError
        when `destination` is no HOST:PORT.
    """

    def __init__(self, device: NativeDevice, destination: str) -> None:
        self._device = device
        self._host, self._port = address(destination)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.counters = {"native": 0, "native_unsent": 0}
        """Datagrams sent, and those that the system did not take."""

    def send(self, reading: Any, epoch_nanos: int) -> None:
        """Send what the device sends with a reading of a run of this epoch."""
        for payload, port in self._device.datagrams(reading, epoch_nanos):
            try:
                self._socket.sendto(payload, (self._host, port or self._port))
                self.counters["native"] += 1
            except OSError:
                self.counters["native_unsent"] += 1

    def close(self) -> None:
        """Send no more."""
        self._socket.close()


class NoLink:
    """Stands in where nobody wants the device's own datagrams."""

    def __init__(self) -> None:
        self.counters: dict[str, int] = {}

    def send(self, reading: Any, epoch_nanos: int) -> None:
        """Send nothing."""

    def close(self) -> None:
        """Nothing was open."""
