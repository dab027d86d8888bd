# SPDX-License-Identifier: Apache-2.0
"""How much longer messages take when each end loses 5 % of what comes to it and asks again.

The lossless ones go the same way without repair, between processes of their own; the two take
turns. Losses happen in the kernel and cost nothing themselves.
"""

from __future__ import annotations

import math
import statistics
from contextlib import closing
from pathlib import Path

from benchmarks.claims import Claim
from udp_bridge.sender.repair import Resend

from .bridge_transports import UdpBridge
from .latency import measure
from .processes import Late
from .result import Part

SIZES = (100_000, 1_000_000, 10_000_000)
LOST = 0.05
LIMIT = Resend(2_000_000_000)
MOST_TIMES = 2.0


class _Lossy(UdpBridge):
    def send(self, size: int) -> float:
        """See `Way`; what is lost for good takes forever."""
        try:
            return super().send(size)
        except Late:
            return math.inf


def run(quick: bool, _: Path) -> Part:
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
            fates = lossy.fates()[:3]
            new = [now - then for now, then in zip(fates, before, strict=True)]
            row = dict(zip(("sent", "delivered", "repaired"), new, strict=True))
            rows.append({"bytes": size, "ms": medians, "ratio": ratio, **row})
            before = fates
            print(
                f"{size:9} {medians[0]:13.3f} {medians[1]:9.3f} {ratio:9.2f} {p99:13.2f}  "
                f"{row['delivered']} of {row['sent']}, {row['repaired']}",
                flush=True,
            )
            what = f"{size} bytes, times as long with 5 % lost"
            claims.append(Claim(what, ratio, MOST_TIMES, is_at_least=False))
    return Part(rows, claims)
