# SPDX-License-Identifier: Apache-2.0
"""Console output of experiments: permanent lines and one progress line."""

import sys
import time

EVERY_S = 10.0
"""Interval of progress lines without a terminal."""


class Console:
    """Prints lines with the elapsed time."""

    def __init__(self) -> None:
        self._begun_s = time.monotonic()
        self._moves = sys.stdout.isatty()
        self._progress_s = self._begun_s
        self._width = 0

    def print(self, line: str) -> None:
        """Print a permanent line."""
        self._clear()
        print(f"[{time.monotonic() - self._begun_s:5.0f} s] {line}", flush=True)

    def progress(self, line: str) -> None:
        """Replace the progress line; without a terminal, print it every `EVERY_S` seconds."""
        if self._moves:
            self._clear()
            print(line, end="\r", flush=True)
            self._width = len(line)
        elif time.monotonic() - self._progress_s >= EVERY_S:
            self._progress_s = time.monotonic()
            self.print(line)

    def _clear(self) -> None:
        if self._width:
            print(" " * self._width, end="\r")
            self._width = 0
