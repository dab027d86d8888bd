# SPDX-License-Identifier: Apache-2.0
"""Terminal output: consoles and a live display.

Without a terminal the display prints periodically.
"""

import shutil
import sys
import time
from collections.abc import Callable

from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
from rich.live import Live
from rich.segment import Segment

PLAIN_PERIOD_SECONDS = 5.0
"""Period of the display without a terminal."""

PLAIN_WIDTH = 110
"""Width without a terminal, unless COLUMNS is set."""


def console(*, stderr: bool = False, plain_width: int = PLAIN_WIDTH) -> Console:
    """Return the console of a command: stdout, or stderr of a command that prints JSON.

    Colors appear on terminals only, and not with NO_COLOR.
    """
    if (sys.stderr if stderr else sys.stdout).isatty():
        return Console(stderr=stderr)
    return Console(stderr=stderr, width=width(plain_width))


def width(plain_width: int = PLAIN_WIDTH) -> int:
    """Return the width of the terminal, or COLUMNS."""
    return shutil.get_terminal_size((plain_width, 0)).columns


def say(shown: Console, line: str) -> None:
    """Print a line without wrapping and markup."""
    shown.print(line, markup=False, highlight=False, soft_wrap=True)


class CroppedPicture:
    """A picture whose last rows are left out on a terminal that is too low for it.

    Parameters
    ----------
    rows_below
        rows that the terminal needs below the picture.
    """

    def __init__(self, picture: RenderableType, *, rows_below: int) -> None:
        self._picture, self._rows_below = picture, rows_below

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render the rows that fit."""
        rows = console.render_lines(self._picture, options, pad=False)
        room = max(console.height - self._rows_below, 1)
        if console.is_terminal and len(rows) > room:
            rows = [*rows[: room - 1], [Segment("...")]]
        for row in rows:
            yield from row
            yield Segment.line()


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
