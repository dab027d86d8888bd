# SPDX-License-Identifier: Apache-2.0
"""`python -m benchmarks.bridge [--quick] [--figure FILE] [--busy N]`: how long messages take.

Messages of 1 kB to 16 MB go in turn by each way, so that all share the machine's moods: compare
within a line. Printed are medians in milliseconds from the call to send until the ROS side calls
`publish`, and the ratios that the documents claim. `--busy 2` lets two processes compute beside.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

from .figure import draw
from .ways import CProgram, RosSharp, Tcp, Took, UdpBridge, Way

SIZES = (1_000, 10_000, 100_000, 1_000_000, 5_000_000, 10_000_000, 16_000_000)
_WARM_UP = 3
_BUSY = "while True: pass"


def main(arguments: Sequence[str]) -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.bridge")
    parser.add_argument("--quick", action="store_true", help="few messages of fewer sizes")
    parser.add_argument("--figure", metavar="FILE", type=Path, help="draw the paper's Figure 9")
    parser.add_argument("--busy", metavar="N", type=int, default=0, help="processes beside")
    options = parser.parse_args(arguments)
    sizes = (1_000, 1_000_000, 10_000_000) if options.quick else SIZES
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        ways: list[Way] = [UdpBridge(), CProgram(folder), Tcp(), RosSharp()]
        for way in ways:
            stack.enter_context(closing(way))
        for _ in range(options.busy):
            busy = subprocess.Popen([sys.executable, "-c", _BUSY])
            stack.callback(busy.wait)
            stack.callback(busy.kill)
        print(_heading([way.name for way in ways]), flush=True)
        medians = []
        for size in sizes:
            count = 8 if options.quick else max(15, min(100, 100_000_000 // size))
            took = measure(ways, size, count)
            print(_line(size, took), flush=True)
            medians.append([statistics.median(t.published for t in row) for row in took])
    if options.figure is not None:
        draw(options.figure, sizes, [way.name for way in ways], medians)
        print(f"drawn to {options.figure}")


def measure(ways: Sequence[Way], size: int, count: int) -> list[list[Took]]:
    """Send `count` messages by each way in turn; return what each took, way by way."""
    took: list[list[Took]] = [[] for _ in ways]
    for _ in range(count + _WARM_UP):
        for way, row in zip(ways, took, strict=True):
            row.append(way.send(size))
    return [row[_WARM_UP:] for row in took]


def _heading(names: Sequence[str]) -> str:
    columns = [f"{name:>11}" for name in names]
    return " ".join([f"{'bytes':>9}", *columns, "  ROS#/ours  of C's throughput"])


def _line(size: int, took: Sequence[Sequence[Took]]) -> str:
    medians = [statistics.median(t.published for t in row) for row in took]
    ours, c_program = (statistics.median(t.whole for t in row) for row in took[:2])
    columns = [f"{median:11.3f}" for median in medians]
    share = c_program / ours
    return " ".join([f"{size:9}", *columns, f"{medians[3] / medians[0]:12.1f} {share:16.2f}"])


if __name__ == "__main__":
    main(sys.argv[1:])
