# SPDX-License-Identifier: Apache-2.0
"""Latency of single messages of 1 kB to 16 MB until ROS's `publish` is called, for each transport.

Messages alternate between the transports, so that all see the same load: compare within a line. The
order is random, because a transport leaves work (caches, memory to free) to the next one.
"""

import random
import statistics
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim

from .bridge_transports import BusTransport, UdpBridge
from .transports import CProgram, Rosbridge, RosSharp, Tcp, Transport

SIZES = (1_000, 10_000, 100_000, 1_000_000, 5_000_000, 10_000_000, 16_000_000)
QUICK_SIZES = (1_000, 1_000_000, 10_000_000)
LARGE = 1_000_000
PAPER_SMALL, PAPER_LARGE = 2.0, 9.5
"""How many times faster than ROS# the paper found its bridge."""
GOAL = {10_000_000: 20.0}
"""What is claimed beyond the paper's ratio."""
FROM_THE_BUS = 10_000_000
"""Size of which is claimed how much longer it takes from a sensor."""
_WARM_UP = 5


def run(quick: bool, folder: Path, rosbridge: Path | None = None) -> BenchmarkResult:
    """Measure and print; by a real rosbridge too where its `rosbridge_websocket` is given."""
    rows, claims = [], []
    with ExitStack() as stack:
        transports: list[Transport] = []
        makers: tuple[Callable[[], Transport], ...] = (
            *(UdpBridge, BusTransport, partial(BusTransport, "router")),
            *(partial(CProgram, folder), Tcp, RosSharp),
        )
        for make in makers:
            transports.append(stack.enter_context(closing(make())))
        if rosbridge is not None:
            transports.append(stack.enter_context(closing(Rosbridge(rosbridge))))
        names = [way.name for way in transports]
        print("\nUntil ROS's publish call (C program: until whole), medians in ms:")
        print(" ".join([f"{'bytes':>9}", *(f"{n:>12}" for n in names), "  ROS#/ours  messages"]))
        for size in QUICK_SIZES if quick else SIZES:
            count = 3 if quick else max(21, min(100, 100_000_000 // size))
            took = measure(transports, size, count)
            medians = dict(zip(names, map(statistics.median, took), strict=True))
            ratio = medians[RosSharp.name] / medians[UdpBridge.name]
            columns = " ".join(f"{median:12.3f}" for median in medians.values())
            print(f"{size:9} {columns} {ratio:11.1f} {count:9}", flush=True)
            rows.append({"bytes": size, "count": count, "ms": medians})
            paper = PAPER_LARGE if size >= LARGE else PAPER_SMALL
            what = f"{size} bytes, times faster than the ROS# way"
            claims.append(Claim(what, ratio, GOAL.get(size, paper)))
            if size == FROM_THE_BUS:
                ours, router = medians["from the bus"], medians["by a router"]
                what = f"{size} bytes, times as long from the bus as from `send`"
                claims.append(Claim(what, ours / medians[UdpBridge.name], 2.0, is_at_least=False))
                what = f"{size} bytes, times as long by a router as from the bus"
                claims.append(Claim(what, router / ours, 1.3))
    return BenchmarkResult(rows, claims)


def measure(transports: Sequence[Transport], size: int, count: int) -> list[list[float]]:
    """Send `count` messages by each way in turn; return what each took in ms, way by way."""
    took: list[list[float]] = [[] for _ in transports]
    for order in orders(size, len(transports), count + _WARM_UP):
        for which in order:
            took[which].append(transports[which].send(size))
    return [row[_WARM_UP:] for row in took]


def orders(seed: int, transports: int, rounds: int) -> Iterator[list[int]]:
    """Yield a random order of the transports for each round."""
    generator = random.Random(seed)
    for _ in range(rounds):
        yield generator.sample(range(transports), transports)
