# SPDX-License-Identifier: Apache-2.0
"""What is left to the thread that receives credits: nobody waits for another one for ever."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from udp_bridge.io.native import batch_io

STRESS = Path(__file__).with_name("delegated_sends_under_stress.py")
PATIENCE_S = 120.0


@pytest.mark.skipif(batch_io is None, reason="the C extension was not built")
def test_who_takes_an_order_back_and_who_carries_it_out_do_not_wait_for_each_other() -> None:
    # A process of its own: threads that wait for each other may keep the interpreter.
    done = subprocess.run(
        [sys.executable, str(STRESS)], capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 0
