# SPDX-License-Identifier: Apache-2.0
"""Throughput of consecutive messages, compared with the C program.

Both send as fast as their window allows, both receivers keep one message while the next one
arrives, and neither publishes. Rounds alternate, and so does which of the two begins.
"""

import statistics
from contextlib import closing
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim

from .bridge_transports import UdpBridge
from .transports import CProgram, StreamingTransport

SIZES = (1_000, 100_000, 1_000_000, 16_000_000)
LEAST_SHARE = {1_000_000: 0.55, 16_000_000: 0.6}
"""Claimed share of the C program's throughput. Smaller messages depend on who wakes whom."""
ROUND_BYTES = 400_000_000
MOST_MESSAGES = 2000
"""Of a round: all of 1 kB fit into the receive buffer, because they need no credit."""


def run(quick: bool, folder: Path) -> BenchmarkResult:
    """Measure and print."""
    rounds = 3 if quick else 25
    rows, claims = [], []
    with closing(UdpBridge("library")) as ours, closing(CProgram(folder)) as program:
        print("\nOne message after the other, medians in MB/s, each way in turn:")
        print(
            f"{'bytes':>9} {ours.name:>12} {program.name:>12}  ours/C  messages each, all arrived"
        )
        delivered = 0
        for size in SIZES:
            count = min(MOST_MESSAGES, ROUND_BYTES // (12 if quick else 1) // size)
            rates = measure((ours, program), size, count, rounds)
            share = statistics.median(a / b for a, b in zip(*rates, strict=True))
            medians = [statistics.median(row) for row in rates]
            summary = ours.summary()
            sent, delivered = summary.delivered - delivered, summary.delivered
            columns = " ".join(f"{median:12.0f}" for median in medians)
            print(f"{size:9} {columns} {share:7.2f}  {rounds} x {count}", flush=True)
            rows.append({"bytes": size, "sent": (rounds + 1) * count, "delivered": sent})
            what = f"{size} bytes, of the C program's throughput"
            if size in LEAST_SHARE:
                claims.append(Claim(what, share, LEAST_SHARE[size]))
        print(f"{'':9} total: {summary.delivered} of {summary.sent} delivered, as reported")
    return BenchmarkResult(rows, claims)


def measure(
    transports: tuple[StreamingTransport, StreamingTransport], size: int, count: int, rounds: int
) -> tuple[list[float], list[float]]:
    """Return the MB/s of each round of `count` messages, way by way; one round warms up."""
    rates: tuple[list[float], list[float]] = [], []
    for index in range(rounds + 1):
        for which in (0, 1) if index % 2 else (1, 0):
            took_ms = transports[which].stream(size, count)
            rates[which].append(size * count / took_ms / 1e3)
    return rates[0][1:], rates[1][1:]
