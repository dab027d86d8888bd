# SPDX-License-Identifier: Apache-2.0
"""Latency from the call of `send` to the callback of a subscriber that gets filled messages.

The subscriber is a plain ROS 2 node. A plain node that publishes the same images takes the part of
the fastest possible source. Messages alternate between the transports in random order, one after
the other (hot) or with a pause before each (at rest), after which caches are cold.
"""

import statistics
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

from benchmarks.claims import BenchmarkResult

from .bridge_transports import UdpBridge, reach
from .latency import orders
from .processes import LineProcess, python
from .transports import RECEIVERS, PlainRos, RosSharp, Tcp, Transport

SIZES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
PAUSES_S = {"hot": 0.0, "at rest": 0.01}
JOIN_S = 2.0
_WARM_UP = 5


def run(quick: bool, folder: Path) -> BenchmarkResult:
    """Measure and print."""
    rows = []
    with ExitStack() as stack:
        subscriber = stack.enter_context(closing(python(RECEIVERS, "callback")))
        subscriber.number()
        made = [make() for make in (UdpBridge, Tcp, PlainRos, RosSharp)]
        transports: list[Transport] = [stack.enter_context(closing(way)) for way in made]
        for way in transports:
            reach(partial(until_callback, way, subscriber, 1000, JOIN_S))
        names = [way.name for way in transports]
        print("\nUntil the callback of a subscriber, medians in ms:")
        print(" ".join([f"{'bytes':>9} {'':7}", *(f"{name:>12}" for name in names), " messages"]))
        for size in SIZES:
            for pause, pause_s in PAUSES_S.items():
                count = 3 if quick else max(21, min(100, 100_000_000 // size))
                took = measure(transports, subscriber, size, count, pause_s)
                medians = dict(zip(names, map(statistics.median, took), strict=True))
                columns = " ".join(f"{median:12.3f}" for median in medians.values())
                print(f"{size:9} {pause:7} {columns} {count:9}", flush=True)
                rows.append({"bytes": size, "pause": pause, "count": count, "ms": medians})
    return BenchmarkResult(rows, [])


def measure(
    transports: Sequence[Transport], subscriber: LineProcess, size: int, count: int, pause_s: float
) -> list[list[float]]:
    """Send `count` messages by each transport; return what each took in ms, by transport."""
    took: list[list[float]] = [[] for _ in transports]
    for order in orders(size, len(transports), count + _WARM_UP):
        for which in order:
            time.sleep(pause_s)
            took[which].append(until_callback(transports[which], subscriber, size))
    return [row[_WARM_UP:] for row in took]


def until_callback(
    way: Transport, subscriber: LineProcess, size: int, timeout_s: float = 30.0
) -> float:
    """Send a message; return what it took in ms."""
    way.send(size)
    return (subscriber.number(timeout_s) - way.began_nanos) / 1e6
