# SPDX-License-Identifier: Apache-2.0
"""Connection of a command to a running run, and what such commands print."""

import argparse
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from groundlink.bus.session import Bus
from groundlink.cli.terminal.progress import progress
from groundlink.core.clock import TICK_SECONDS
from groundlink.process import runner as process
from groundlink.process.joining import join
from groundlink.scenario import Scenario

Joining = Callable[[Bus, str | None, threading.Event], tuple[str, Scenario]]


@contextmanager
def joined(
    options: argparse.Namespace,
    *,
    stop: threading.Event | None = None,
    observer: bool = False,
    joining: Joining = join,
) -> Iterator[tuple[Bus, str, Scenario]]:
    """Yield the bus of `--connect`, and the name and scenario of the run of `--run`.

    Raises
    ------
    UserError
        as `Bus` and `join` do.
    """
    endpoint = process.endpoint(options)
    with Bus(connect=endpoint, observer=observer) as bus:
        with progress(f"looking for a run at {endpoint}"):
            run, scenario = joining(bus, options.run, stop or threading.Event())
        yield bus, run, scenario


def at_tick(run: str, tick: int, **facts: object) -> dict[str, object]:
    """Return facts about a run at a tick, for `--json`."""
    return {"run": run, "tick": tick, "sim_seconds": tick * TICK_SECONDS, **facts}


def tick_text(tick: int) -> str:
    """Return a tick with its sim time."""
    return f"tick {tick} ({tick * TICK_SECONDS:.4f} s)"
