# SPDX-License-Identifier: Apache-2.0
"""Liveness file: a process touches it while it is healthy and connected to its router.

The health check of a container inspects the age of the file only.
"""

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

VARIABLE = "ALIVE_FILE"
"""Environment variable with the file name; without it no file is touched."""


class LivenessFile:
    """Touches the file, and logs when the connection to the router is lost and restored."""

    def __init__(
        self, process: str, is_connected: Callable[[], bool], environment: Mapping[str, str]
    ) -> None:
        name = environment.get(VARIABLE)
        self._process, self._is_connected = process, is_connected
        self._file = Path(name) if name else None
        self._disconnected_since: float | None = None

    def update(self, now_seconds: float) -> None:
        """Touch the file if connected; the time is of a monotonic clock."""
        if self._is_connected():
            if self._disconnected_since is not None:
                seconds = now_seconds - self._disconnected_since
                self._log(f"reconnected to the router after {seconds:.1f} s")
                self._disconnected_since = None
            if self._file is not None:
                self._file.touch()
        elif self._disconnected_since is None:
            self._disconnected_since = now_seconds
            self._log("connection to the router lost; reconnecting")

    def _log(self, text: str) -> None:
        print(f"{self._process}: {text}", file=sys.stderr, flush=True)
