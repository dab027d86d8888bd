# SPDX-License-Identifier: Apache-2.0
"""Worker thread: repeats one turn until that returns False, and survives exceptions.

An exception of a turn is counted and logged, and the thread continues with the next turn. A thread
that ends in any other way ends the process with status 1, so that a supervisor restarts it: a
process that runs on without its threads looks healthy and transfers nothing.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from typing import Callable

from udp_bridge.wire.header import NANOS

LOG_PERIOD_NANOS = 10 * NANOS
"""At most one exception is logged in this time; all are counted."""
MOST_FAILURES = 1000
"""Consecutive turns that may raise. More of them are no bad input but a fault that persists."""
EXIT_STATUS = 1
_log = logging.getLogger(__name__)


class ErrorCounter:
    """Counts exceptions of any thread and logs some of them, with their tracebacks."""

    def __init__(self) -> None:
        self.count = 0
        self._log_nanos = time.monotonic_ns()
        self._lock = threading.Lock()

    def caught(self, what: str) -> None:
        """Count the exception that is being handled; `what` raised it."""
        now_nanos = time.monotonic_ns()
        with self._lock:
            self.count += 1
            is_logged = now_nanos >= self._log_nanos
            if is_logged:
                self._log_nanos = now_nanos + LOG_PERIOD_NANOS
        if is_logged:
            _log.exception("%s failed (errors=%d); continuing", what, self.count)


class WorkerThread(threading.Thread):
    """A daemon thread that repeats a turn.

    Parameters
    ----------
    name
        Name of the thread in log lines.
    turn
        Returns whether there is a next turn.
    errors
        Counts what a turn raises.
    """

    def __init__(self, name: str, turn: Callable[[], bool], errors: ErrorCounter) -> None:
        super().__init__(name=name, daemon=True)
        self._turn = turn
        self._errors = errors

    def run(self) -> None:
        """Repeat the turn; end the process if that is not possible."""
        try:
            self._repeat()
        except BaseException as error:
            _log.critical("%s: thread ended, ending the process (error=%r)", self.name, error)
            os._exit(EXIT_STATUS)
        del self._turn  # it refers to the owner of this thread

    def _repeat(self) -> None:
        failures = 0
        is_on = True
        while is_on:
            try:
                is_on = self._turn()
                failures = 0
            except Exception:
                failures += 1
                if failures > MOST_FAILURES:
                    raise
                self._errors.caught(self.name)
