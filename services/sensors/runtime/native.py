# SPDX-License-Identifier: Apache-2.0
"""UDP output in a device's native format, in addition to the readings on the bus.

Datagrams are sent when a reading is published. They are not acknowledged or repeated, and a missing
receiver has no effect on the run.
"""

import socket
from typing import Any

from groundlink.process.runner import address

from .model import NativeDevice


class NativeLink:
    """UDP link of one device to its destination.

    Raises
    ------
    UserError
        when `destination` is not a valid HOST:PORT.
    """

    def __init__(self, device: NativeDevice, destination: str) -> None:
        self._device = device
        self._host, self._port = address(destination)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self.counters = {"native": 0, "native_unsent": 0}
        """Number of datagrams sent, and of datagrams that the operating system rejected."""

    def send(self, reading: Any, epoch_nanos: int) -> None:
        """Send the datagrams of a published reading; `epoch_nanos` is the epoch of the run."""
        for payload, port in self._device.datagrams(reading, epoch_nanos):
            try:
                self._socket.sendto(payload, (self._host, port or self._port))
                self.counters["native"] += 1
            except OSError:
                self.counters["native_unsent"] += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class NoLink:
    """Null object for a sensor without native output."""

    def __init__(self) -> None:
        self.counters: dict[str, int] = {}

    def send(self, reading: Any, epoch_nanos: int) -> None:
        """Ignore the reading."""

    def close(self) -> None:
        """Do nothing; no socket is open."""
