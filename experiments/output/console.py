# SPDX-License-Identifier: Apache-2.0
"""Console output of experiments: permanent lines and one progress line."""

from __future__ import annotations

import sys
import time

EVERY_S = 10.0
"""Where lines cannot move, a progress is printed as often."""


class Console:
    """Prints lines; call it with one."""

    def __init__(self) -> None:
        self._begun_s = time.monotonic()
        self._moves = sys.stdout.isatty()
        self._progress_s = self._begun_s
        self._width = 0

    def __call__(self, line: str) -> None:
        """Print a line that stays."""
        self._clear()
        print(f"[{time.monotonic() - self._begun_s:5.0f} s] {line}", flush=True)

    def progress(self, line: str) -> None:
        """Print a line in place of the last one of its kind."""
        if self._moves:
            self._clear()
            print(line, end="\r", flush=True)
            self._width = len(line)
        elif time.monotonic() - self._progress_s >= EVERY_S:
            self._progress_s = time.monotonic()
            self(line)

    def _clear(self) -> None:
        if self._width:
            print(" " * self._width, end="\r")
            self._width = 0
