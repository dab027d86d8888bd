# SPDX-License-Identifier: Apache-2.0
"""Signals of a process."""

import subprocess
import sys

import pytest

PROGRAM = """
import signal
from groundlink.process.runner import stop_on_signals

stop = stop_on_signals()
assert not stop.is_set()
with stop._cond:  # as `wait` holds it for a moment
    signal.raise_signal(signal.{name})
raise SystemExit(not stop.wait(20))
"""


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_a_process_that_holds_the_lock_of_its_event(name: str) -> None:
    program = PROGRAM.format(name=name)
    subprocess.run([sys.executable, "-c", program], timeout=60, check=True)
