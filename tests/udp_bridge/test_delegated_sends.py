# SPDX-License-Identifier: Apache-2.0
"""Delegated sends: the sending and the receiving thread do not deadlock."""

import subprocess
import sys
from pathlib import Path

import pytest

from udp_bridge.io.native import batch_io

STRESS = Path(__file__).with_name("delegated_sends_under_stress.py")
TIMEOUT_S = 120.0


@pytest.mark.skipif(batch_io is None, reason="the C extension was not built")
def test_reclaiming_and_sending_do_not_deadlock() -> None:
    # A process of its own: threads that wait for each other may keep the interpreter.
    done = subprocess.run(
        [sys.executable, str(STRESS)], capture_output=True, text=True, timeout=TIMEOUT_S
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 0
