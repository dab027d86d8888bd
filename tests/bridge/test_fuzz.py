# SPDX-License-Identifier: Apache-2.0
"""Short runs of the fuzzers; the long ones are commands, see `fuzz/`."""

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz import batches
from fuzz.reassembly import BATCH, recorded, run_batch

ROOT = Path(__file__).parents[2]
SEEDS = 3


@pytest.mark.parametrize("seed", range(SEEDS))
def test_random_and_mutated_datagrams(seed: int) -> None:
    counts = run_batch(seed, recorded())
    assert counts["datagrams"] >= BATCH
    assert counts["refused"] > BATCH / 10
    assert counts["messages"] > BATCH / 100  # otherwise the test would prove little


def test_batches_of_parts_give_what_single_datagrams_give() -> None:
    counts = batches.run_batch(seed=1)
    assert counts["datagrams"] >= BATCH
    assert counts["in_slots"] > BATCH / 10
    assert counts["messages"] > BATCH / 100
    assert counts["small"] > BATCH / 100
    assert counts["whole"] > batches.CALM / 2


@pytest.mark.nightly
@pytest.mark.timeout(400)
def test_the_sanitizers_find_nothing_in_the_extension_modules() -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    command = [sys.executable, "-m", "fuzz.sanitized"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=380, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[:5000]
    modules = "services.sensors.rays._kernels udp_bridge.io.native._batch_io"
    assert f"with sanitizers: {modules}" in done.stdout


@pytest.mark.parametrize(("program", "runs"), [("guided", 2000), ("sequences", 200)])
def test_guided_by_coverage(program: str, runs: int) -> None:
    if importlib.util.find_spec("atheris") is None:
        pytest.skip("atheris is not installed; it has wheels for Linux on x86-64 alone")
    command = [sys.executable, "-m", f"fuzz.{program}", "--runs", str(runs), "--seconds", "30"]
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    executed = re.search(r"stat::number_of_executed_units: (\d+)", done.stderr)
    assert executed is not None
    assert int(executed[1]) >= runs / 10  # a busy machine may not do all of them in time
