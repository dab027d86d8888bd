# SPDX-License-Identifier: Apache-2.0
"""A run whose processes this command starts: tended, heard, shown, and ended with it.

Rule: says why a run is over that its user did not end. When it is over otherwise, and what it was
worth, is the command's own business.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence

from rich.console import Console, Group, RenderableType
from rich.text import Text

from groundlink.bus.core_topics import HEALTH
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.cli.terminal.output import display, say, stop_on_signals
from groundlink.core.errors import UserError
from groundlink.messages.base import Health
from groundlink.monitor.run_monitor import RunMonitor
from groundlink.monitor.supervisor import TOLD, Child, Supervisor

LINES_SHOWN = 5
"""Newest lines of the processes, below the picture of a run."""

LINES_KEPT = 500
"""That are printed when the run is over."""


class SupervisedRun:
    """Processes of a run on this machine, with the run's router and what they tell of themselves.

    Ctrl-C and SIGTERM end it from the time on that it is made.

    Parameters
    ----------
    commands
        by name of the process; see `running.commands`.
    run
        the run's name.
    endpoint
        where the run's router listens.
    shown
        where lines of the processes and the picture go.
    finite
        processes that may end by themselves.
    dispensable
        processes that may be missing.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        run: str,
        endpoint: str,
        shown: Console,
        *,
        finite: Collection[str] = (),
        dispensable: Collection[str] = (),
    ) -> None:
        self.monitor = RunMonitor()
        self.killed: list[str] = []
        """Processes that did not end in time."""
        self._run, self._endpoint, self._shown = run, endpoint, shown
        self._supervisor = Supervisor(commands, self._say, finite=finite, dispensable=dispensable)
        self._stop = stop_on_signals()
        self._lines: deque[str] = deque(maxlen=LINES_KEPT)
        """What processes said, where it is shown below the picture."""

    @property
    def children(self) -> Mapping[str, Child]:
        """The processes by their names."""
        return self._supervisor.children

    def go(
        self, is_over: Callable[[], bool], picture: Callable[[], RenderableType]
    ) -> Child | None:
        """Run until it is over, and end every process.

        Parameters
        ----------
        is_over
            asked again and again.
        picture
            returns how far the run is.

        Returns
        -------
        The process that has ended the run, or that its user must mend; see `exit_code`.
        """
        with Bus(listen=self._endpoint) as bus:
            inbox: BusInbox[Health] = BusInbox(depth=1024)
            bus.subscribe(HEALTH.key_in(self._run), Health, inbox)
            try:
                self._supervisor.start()
                shown = display(self._shown, lambda: self._with_lines(picture()))
                failed = self._tend(inbox, is_over, shown)
            finally:
                self.killed = self._supervisor.stop()
                for line in self._lines:
                    say(self._shown, line)
            self._hear(inbox)
        return failed

    def _tend(
        self, inbox: BusInbox[Health], is_over: Callable[[], bool], show: Callable[[bool], None]
    ) -> Child | None:
        failed = None
        while not (failed or self._stop.is_set() or is_over()):
            failed = self._supervisor.tend()
            self._hear(inbox)
            show(False)
        show(True)
        return self.children[failed] if failed else None

    def _hear(self, inbox: BusInbox[Health]) -> None:
        """Tell the monitor all that waits; wait a moment where nothing does."""
        while arrived := inbox.get(seconds=0.0 if len(inbox) else 0.05):
            self.monitor.update(arrived[1], time.monotonic())
            if self._stop.is_set():
                break

    def _say(self, name: str, line: str) -> None:
        line = line.removeprefix(f"{name}: ")  # Error lines begin with it already.
        self.tell(f"{name}: {line}")

    def tell(self, line: str) -> None:
        """Show a line: below the picture of a run, or at once where there is no terminal."""
        if self._shown.is_terminal:
            self._lines.append(line)
        else:
            say(self._shown, line)

    def _with_lines(self, picture: RenderableType) -> RenderableType:
        """Return the picture above the newest lines."""
        newest = list(self._lines)[-LINES_SHOWN:]
        return Group(picture, *(Text(line, no_wrap=True, overflow="ellipsis") for line in newest))


def exit_code(child: Child) -> int:
    """Say why a run is over that its user did not end; return the command's exit code.

    Parameters
    ----------
    child
        the process that has ended it.
    """
    if child.ended_run:
        print(f"groundlink: {child.name} has ended the run; see its line above", file=sys.stderr)
        return 1
    print(f"groundlink: {child.name} cannot run; see its line above", file=sys.stderr)
    return child.code if child.code in TOLD else UserError.exit_code
