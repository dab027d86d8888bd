# SPDX-License-Identifier: Apache-2.0
"""Latency from the call of `send` to the callback of a subscriber that gets filled messages.

The subscriber is a plain ROS 2 node. A plain node that publishes the same images takes the part of
the fastest possible source. Messages alternate between the transports in random order, one after
the other (hot) or with a pause before each (at rest), after which caches are cold. A real
ROS-TCP-Endpoint and a real rosbridge take part where their programs are given.
"""

import statistics
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim, Row

from .bridge_transports import UdpBridge, reach
from .latency import orders
from .processes import LineProcess, python
from .transports import (
    RECEIVERS,
    PlainRos,
    Rosbridge,
    RosSharp,
    RosTcpEndpoint,
    Tcp,
    Transport,
)

SIZES = (1_000, 10_000, 100_000, 1_000_000, 10_000_000)
PAUSES_S = {"hot": 0.0, "at rest": 0.01}
JOIN_S = 2.0
MOST_TIMES = {
    PlainRos.name: {1_000: 2.0, 10_000: 2.0, 100_000: 2.6, 1_000_000: 2.5, 10_000_000: 1.9},
    RosTcpEndpoint.name: {1_000: 1.4, 10_000: 1.4, 100_000: 1.6, 1_000_000: 1.3, 10_000_000: 1.0},
}
"""By transport and size, how many times as long as by that transport it takes at most, hot."""
TIMES_FASTER = {Rosbridge.name: {1_000_000: 15.0, 10_000_000: 20.0}}
"""The same, how many times faster it is at least."""
_WARM_UP = 5


def run(
    quick: bool, folder: Path, rosbridge: Path | None = None, ros_tcp_endpoint: Path | None = None
) -> BenchmarkResult:
    """Measure and print."""
    rows: list[Row] = []
    claims: list[Claim] = []
    with ExitStack() as stack:
        subscriber = stack.enter_context(closing(python(RECEIVERS, "callback")))
        subscriber.number()
        makers: list[Callable[[], Transport]] = [UdpBridge, Tcp, PlainRos, RosSharp]
        if ros_tcp_endpoint is not None:
            makers.append(partial(RosTcpEndpoint, ros_tcp_endpoint))
        if rosbridge is not None:
            makers.append(partial(Rosbridge, rosbridge))
        transports = [stack.enter_context(closing(make())) for make in makers]
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
                if pause == "hot":
                    claims += judged(size, medians)
    return BenchmarkResult(rows, claims)


def judged(size: int, medians: Mapping[str, float]) -> Iterator[Claim]:
    """Yield the claims about a size, given the medians by transport."""
    ours = medians[UdpBridge.name]
    for name, median in medians.items():
        if size in (limits := MOST_TIMES.get(name, {})):
            what = f"{size} bytes, times as long to a callback as by {name}"
            yield Claim(what, ours / median, limits[size], is_at_least=False)
        if size in (least := TIMES_FASTER.get(name, {})):
            yield Claim(
                f"{size} bytes, times faster to a callback than {name}", median / ours, least[size]
            )


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
