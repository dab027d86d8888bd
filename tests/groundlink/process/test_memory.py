# SPDX-License-Identifier: Apache-2.0
"""Arrays of a reading are allocated in memory that was there before."""

import subprocess
import sys

import pytest

_ARRAYS = """
import resource, sys
import numpy as np
from groundlink.process.memory import keep_memory

if sys.argv[1] == "kept":
    keep_memory()
for reading in range(40):
    if reading == 10:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    rays = [np.ones(100_000) for _ in range(20)]
    del rays
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="only glibc is configured")
def test_arrays_reuse_memory() -> None:
    faults = {}
    for how in ("kept", "returned"):
        command = [sys.executable, "-c", _ARRAYS, how]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
        faults[how] = int(done.stdout)
    assert faults["kept"] < 100 < 10_000 < faults["returned"]
