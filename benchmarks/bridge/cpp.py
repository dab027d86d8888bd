# SPDX-License-Identifier: Apache-2.0
"""Sustained rate of a plain receiver on the C++ header, compared with the library in Python.

The library in Python sends to both, one message after the other, over real sockets; the two
alternate. The sustained rate follows from processor time, the kernel's part included. The message
rate is limited by the sender and shown for information.
"""

import statistics
import subprocess
from contextlib import closing
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim

from .bridge_transports import UdpBridge
from .processes import LineProcess
from .transports import HERE, RECEIVE_BUFFER

SIZES = (1_000, 100_000, 1_000_000)
ROUND_BYTES = 20_000_000
MOST_IN_A_ROUND = 1000
LEAST_TIMES = {1_000: 1.0, 100_000: 1.0, 1_000_000: 0.7}
"""Of 1 MB most of the time is the kernel's; the library receives in place, the header copies."""
HEADER = HERE.parents[1] / "udp-bridge" / "cpp"


class Cpp(UdpBridge):
    """The library on this side and `receiver.cpp` on the other."""

    name = "C++"

    def __init__(self, folder: Path) -> None:
        program = str(folder / "receiver")
        source = str(HERE / "receiver.cpp")
        subprocess.run(
            ["c++", "-std=c++17", "-O2", f"-I{HEADER}", "-o", program, source], check=True
        )
        super().__init__(LineProcess(program, str(RECEIVE_BUFFER)))


def run(quick: bool, folder: Path) -> BenchmarkResult:
    """Measure and print."""
    rounds = 3 if quick else 25
    rows, claims = [], []
    with closing(UdpBridge("library")) as ours, closing(Cpp(folder)) as theirs:
        print("\nReceivers of one message after the other, each in turn, medians a message:")
        print("    bytes  us of a processor: Python      C++   ratio  messages/s: Python     C++")
        for size in SIZES:
            count = min(MOST_IN_A_ROUND, ROUND_BYTES // size) // (4 if quick else 1)
            spent, rates = measure((ours, theirs), size, count, rounds)
            times = statistics.median(a / b for a, b in zip(*spent, strict=True))
            us = [statistics.median(row) for row in spent]
            per_s = [statistics.median(row) for row in rates]
            rows.append({"bytes": size, "us": us, "per_s": per_s, "times": times})
            columns = f"{us[0]:25.1f} {us[1]:8.1f} {times:7.2f} {per_s[0]:19.0f} {per_s[1]:7.0f}"
            print(f"{size:9} {columns}  {rounds} x {count}", flush=True)
            what = f"{size} bytes, what C++ sustains in times of Python"
            claims.append(Claim(what, times, LEAST_TIMES[size]))
    return BenchmarkResult(rows, claims)


def measure(
    transports: tuple[UdpBridge, UdpBridge], size: int, count: int, rounds: int
) -> tuple[tuple[list[float], list[float]], tuple[list[float], list[float]]]:
    """Return processor time a message in us and messages a second of each round, way by way."""
    spent: tuple[list[float], list[float]] = [], []
    rates: tuple[list[float], list[float]] = [], []
    for index in range(rounds + 1):
        for which in (0, 1) if index % 2 else (1, 0):
            before = transports[which].receiver.spent_nanos()
            took_ms = transports[which].stream(size, count)
            if index:  # the first one warms up
                spent[which].append(
                    (transports[which].receiver.spent_nanos() - before) / count / 1e3
                )
                rates[which].append(count / took_ms * 1e3)
    return spent, rates
