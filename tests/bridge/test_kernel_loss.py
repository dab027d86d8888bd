# SPDX-License-Identifier: Apache-2.0
"""Repair of datagrams that the kernel drops, instead of the link emulation."""

import importlib.util
import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from .kernel_loss import LOSS, MESSAGES, PARTS
from .programs import need

ROOT = Path(__file__).parents[2]
SIGMAS = 6.0
"""The kernel's random numbers have no seed."""
NAMESPACES = (["unshare", "--net"], ["unshare", "--net", "--map-root-user"])
"""As root, and as an unprivileged user where the system allows user namespaces."""
LOSSY = "iptables -A INPUT -m statistic --mode random --probability 0.5".split()


@pytest.mark.system
def test_repair_of_what_the_kernel_drops() -> None:
    need("iptables")
    need("unshare")
    if importlib.util.find_spec("raptorq") is None:
        pytest.skip("raptorq is not installed: pip install udp-bridge[fec]")
    unshare = _allowed()
    done = subprocess.run(
        [*unshare, sys.executable, "-m", "tests.bridge.kernel_loss"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["kernel"] > LOSS * MESSAGES * PARTS
    assert not any(row["different"] for row in result["modes"].values())
    plain = result["modes"]["none"]
    share = (1 - LOSS) ** PARTS
    bound = SIGMAS * math.sqrt(plain["sent"] * share * (1 - share))
    assert abs(plain["arrived"] - plain["sent"] * share) <= bound, result
    for mode in ("fec", "resend"):
        repaired = result["modes"][mode]
        assert repaired["arrived"] >= 0.97 * repaired["sent"], result
        assert repaired["sent"] > MESSAGES / 2


def _allowed() -> list[str]:
    """Return the command that enters a namespace with packet loss; skip the test without one."""
    errors = []
    for command in NAMESPACES:
        probe = subprocess.run(
            [*command, *LOSSY], capture_output=True, text=True, timeout=20, check=False
        )
        if not probe.returncode:
            return command
        errors.append(probe.stderr.strip())
    pytest.skip(f"no network namespace with packet loss: {'; '.join(errors)}")
