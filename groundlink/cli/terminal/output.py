# SPDX-License-Identifier: Apache-2.0
"""Terminal output: a live display, and Ctrl-C. Without a terminal it prints periodically."""

import signal
import sys
import threading
import time
from collections.abc import Callable
from types import FrameType

from rich.console import Console, RenderableType
from rich.live import Live

PLAIN_PERIOD_SECONDS = 5.0
"""Period of the display without a terminal."""

PLAIN_WIDTH = 110


def console() -> Console:
    """Return the console of a command."""
    return Console() if sys.stdout.isatty() else Console(width=PLAIN_WIDTH)


def say(shown: Console, line: str) -> None:
    """Print a line without wrapping and markup."""
    shown.print(line, markup=False, highlight=False, soft_wrap=True)


def display(shown: Console, picture: Callable[[], RenderableType]) -> Callable[[bool], None]:
    """Return a function that updates the display; its argument is True for the last update."""
    if shown.is_terminal:
        live = Live(console=shown, get_renderable=picture, refresh_per_second=4, transient=True)
        live.start()
        return lambda last: live.stop() if last else None
    next_print = time.monotonic() + PLAIN_PERIOD_SECONDS

    def show(last: bool) -> None:
        nonlocal next_print
        if not last and time.monotonic() >= next_print:
            next_print += PLAIN_PERIOD_SECONDS
            shown.print(picture())

    return show


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set."""
    stop = threading.Event()

    def on_signal(number: int, frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop
