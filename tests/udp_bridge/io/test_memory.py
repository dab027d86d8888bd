# SPDX-License-Identifier: Apache-2.0
"""Large bodies are copied into memory that was there before, in a thread as in a node."""

import resource
import subprocess
import sys

import pytest

_COPIES = """
import resource, sys, threading
from udp_bridge.io.memory import keep_memory

def copy():
    global faults
    body = bytearray(5_000_000)
    for index in range(40):
        if index == 10:
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        copies = [bytes(body), bytes(body)]
        del copies
    faults = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

if sys.argv[1] == "kept":
    keep_memory()
thread = threading.Thread(target=copy)
thread.start()
thread.join()
print(faults)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc's memory alone is told")
def test_large_copies_find_their_memory_again() -> None:
    faults = {}
    for how in ("kept", "as it is"):
        command = [sys.executable, "-c", _COPIES, how]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
        faults[how] = int(done.stdout)
    pages_of_a_body = 5_000_000 // resource.getpagesize()
    assert faults["kept"] < pages_of_a_body < faults["as it is"]
