# SPDX-License-Identifier: Apache-2.0
"""How those outside the node see that it is well: a file that it touches.

Rule: touched once a second while the node turns and a gateway is heard, so that the file's age is
all that a container's health check needs. A gateway is heard even when time stands still: it
repeats its wishes every second.
"""

from __future__ import annotations

from pathlib import Path
from typing import Mapping

VARIABLE = "ALIVE_FILE"
"""Environment variable with the file's name; without it nothing is touched."""

PERIOD_NANOS = 1_000_000_000


class NodeLiveness:
    """Whether the node is well, shown to the machine it runs on."""

    def __init__(self, environment: Mapping[str, str]) -> None:
        name = environment.get(VARIABLE)
        self._file = Path(name) if name else None
        self._due_nanos = 0
        self._heard = 0

    def is_due(self, now_nanos: int) -> bool:
        """Return whether a second has passed since it was shown."""
        return now_nanos >= self._due_nanos

    def show(self, received_datagrams: int, now_nanos: int) -> None:
        """Touch the file when more has been received than at the last call."""
        self._due_nanos = now_nanos + PERIOD_NANOS
        if self._file is not None and received_datagrams != self._heard:
            self._heard = received_datagrams
            self._file.touch()
