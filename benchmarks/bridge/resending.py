# SPDX-License-Identifier: Apache-2.0
"""Latency with retransmission when each end loses 5 % of the received datagrams.

It is compared with a lossless link without repair between other processes; the two alternate.
Losses happen in the kernel and cost no time.
"""

import math
import statistics
from contextlib import closing
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim
from udp_bridge.sender.repair import Resend

from .bridge_transports import UdpBridge
from .latency import measure
from .processes import TimedOut

SIZES = (100_000, 1_000_000, 10_000_000)
LOST = 0.05
LIMIT = Resend(2_000_000_000)
MOST_TIMES = 3.0
"""Half of the messages of 1 MB wait for a round trip, which takes as long as the message itself."""


class _Lossy(UdpBridge):
    def send(self, size: int) -> float:
        """See `Transport`; what is lost for good takes forever."""
        try:
            return super().send(size)
        except TimedOut:
            return math.inf


def run(quick: bool, _: Path) -> BenchmarkResult:
    """Measure and print."""
    count = 20 if quick else 200
    rows, claims = [], []
    before = (0, 0, 0)
    print(f"\n{100 * LOST:.0f} % of datagrams lost each way and resent, medians in ms:")
    print("    bytes  nothing lost  5 % lost     ratio     p99, lost  arrived, of these repaired")
    with (
        closing(UdpBridge("library")) as whole,
        closing(_Lossy("library", lost=LOST, repair=LIMIT)) as lossy,
    ):
        for size in SIZES:
            took = measure((whole, lossy), size, count)
            medians = [statistics.median(row) for row in took]
            ratio = medians[1] / medians[0]
            p99 = sorted(took[1])[count * 99 // 100]
            summary = lossy.summary()[:3]
            new = [now - then for now, then in zip(summary, before, strict=True)]
            row = dict(zip(("sent", "delivered", "repaired"), new, strict=True))
            rows.append({"bytes": size, "ms": medians, "ratio": ratio, **row})
            before = summary
            print(
                f"{size:9} {medians[0]:13.3f} {medians[1]:9.3f} {ratio:9.2f} {p99:13.2f}  "
                f"{row['delivered']} of {row['sent']}, {row['repaired']}",
                flush=True,
            )
            what = f"{size} bytes, times as long with 5 % lost"
            claims.append(Claim(what, ratio, MOST_TIMES, is_at_least=False))
    return BenchmarkResult(rows, claims)
