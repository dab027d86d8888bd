# SPDX-License-Identifier: Apache-2.0
"""Liveness file: touched once a second while the node runs and receives from a gateway.

A container's health check needs only the file's age. A gateway repeats its subscriptions every
second, so it is received from even while sim time is paused.
"""

from __future__ import annotations

from pathlib import Path
from typing import Mapping

VARIABLE = "ALIVE_FILE"
"""Environment variable with the file's name; without it nothing is touched."""

PERIOD_NANOS = 1_000_000_000


class NodeLiveness:
    """Touches the liveness file of a node."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        name = environment.get(VARIABLE)
        self._file = Path(name) if name else None
        self._due_nanos = 0
        self._received = 0

    def is_due(self, now_nanos: int) -> bool:
        """Return whether a second has passed since the last call of `touch`."""
        return now_nanos >= self._due_nanos

    def touch(self, received_datagrams: int, now_nanos: int) -> None:
        """Touch the file when more datagrams have been received than at the last call."""
        self._due_nanos = now_nanos + PERIOD_NANOS
        if self._file is not None and received_datagrams != self._received:
            self._received = received_datagrams
            self._file.touch()
