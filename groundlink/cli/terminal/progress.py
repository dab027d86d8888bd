# SPDX-License-Identifier: Apache-2.0
"""Progress bars on stderr, of work that takes over a second. Without a terminal there are none."""

import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from rich.console import Console

T = TypeVar("T")

SHOWN_AFTER_SECONDS = 1.0
"""Shorter work shows no bar, which would only flicker."""

UPDATES = 100
"""Most updates of a bar by `tracked`; one takes about 10 us."""


@contextmanager
def progress(what: str) -> Iterator[Callable[[float], None]]:
    """Show a bar during a block. Yields a function for the share done, 0 to 1.

    Before the first call of that function the bar moves without end.
    """
    if not sys.stderr.isatty():
        yield lambda share: None
        return
    from rich.progress import Progress

    bar = Progress(
        console=Console(stderr=True),
        transient=True,
        # Lines of the block stand above the bar if both go to the same terminal.
        redirect_stdout=sys.stdout.isatty(),
    )
    task = bar.add_task(what, total=None)
    start = threading.Timer(SHOWN_AFTER_SECONDS, bar.start)
    start.daemon = True
    start.start()
    try:
        yield lambda share: bar.update(task, total=1.0, completed=share)
    finally:
        start.cancel()
        start.join()
        bar.stop()


def tracked(items: Iterable[T], what: str, total: int | None) -> Iterator[T]:
    """Yield the items of an iterable, of known length or None, with a bar."""
    step = -(-(total or 1) // UPDATES)
    with progress(what) as done:
        for number, item in enumerate(items):
            if total and number % step == 0:
                done(number / total)
            yield item
