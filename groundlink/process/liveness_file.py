# SPDX-License-Identifier: Apache-2.0
"""How those outside a process see that it is well: a file that it touches.

Rule: touched by a process that beats and has a link to its router, and by no other, so that the
file's age is all that a health check of a container needs to look at. What changes is said once.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

VARIABLE = "ALIVE_FILE"
"""Environment variable with the file's name; without it nothing is touched."""


class LivenessFile:
    """Whether a process is well, shown to the machine it runs on.

    Parameters
    ----------
    is_linked
        says whether the process has a link to its router.
    """

    def __init__(
        self, process: str, is_linked: Callable[[], bool], environment: Mapping[str, str]
    ) -> None:
        name = environment.get(VARIABLE)
        self._process, self._is_linked = process, is_linked
        self._file = Path(name) if name else None
        self._cut_off_since: float | None = None

    def show(self, now_seconds: float) -> None:
        """Show how it is at an instant of a clock that never jumps."""
        if self._is_linked():
            if self._cut_off_since is not None:
                self._say(f"the router is back after {now_seconds - self._cut_off_since:.1f} s")
                self._cut_off_since = None
            if self._file is not None:
                self._file.touch()
        elif self._cut_off_since is None:
            self._cut_off_since = now_seconds
            self._say("no link to the router; looking for it")

    def _say(self, text: str) -> None:
        print(f"{self._process}: {text}", file=sys.stderr, flush=True)
