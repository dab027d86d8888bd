# SPDX-License-Identifier: Apache-2.0
"""Messages of 10 MB under CPU contention: two other processes, or a thread of the receiver.

Processes cost time, and would cost datagrams if more were in flight than the receive buffer holds.
A Python thread holds the interpreter lock for up to 5 ms at a time.
"""

import statistics
from contextlib import closing
from pathlib import Path

from benchmarks.claims import BenchmarkResult, Claim

from .bridge_transports import PLAIN, DeliverySummary, UdpBridge
from .processes import busy_processes

SIZE = 10_000_000
BUSY = 2
_WARM_UP = 3


def processes(quick: bool, folder: Path) -> BenchmarkResult:
    """Count what is lost while two processes compute beside; print."""
    count = 5 if quick else 100
    rows, lost, drops = [], 0, 0
    print(f"\n{SIZE} bytes without privileges; lost is what has not arrived:")
    print(
        "busy beside  receiver               sent   lost  kernel drops        took  receive buffer"
    )
    for busy in (0, BUSY):
        for receiver in ("node", "library"):
            with closing(UdpBridge(receiver)) as ours, busy_processes(busy):
                for _ in range(_WARM_UP):
                    ours.send(SIZE)
                if receiver == "node":
                    what = "ROS node, one by one"
                    took = f"{statistics.median(ours.send(SIZE) for _ in range(count)):6.2f} ms"
                else:
                    what = "library, streamed"
                    took = f"{SIZE * count / ours.stream(SIZE, count) / 1e3:6.0f} MB/s"
                summary = ours.summary()
            missing = summary.sent - summary.delivered
            print(
                f"{busy:11}  {what:20} {summary.sent:6} {missing:6} {summary.kernel_drops:13} "
                f"{took:>11} {summary.receive_buffer:15}",
                flush=True,
            )
            rows.append({"busy": busy, "receiver": receiver, "took": took, **summary._asdict()})
            lost += missing
            drops += summary.kernel_drops
            claims = _claims(lost, drops, summary)
    return BenchmarkResult(rows, claims)


def _claims(lost: int, drops: int, summary: DeliverySummary) -> list[Claim]:
    limit = 2 * int(Path("/proc/sys/net/core/rmem_max").read_text(encoding="ascii"))
    return [
        Claim("10 MB: messages lost", lost, 0, is_at_least=False),
        Claim("10 MB: datagrams dropped by the kernel", drops, 0, is_at_least=False),
        Claim("receive buffer, of what anybody gets", summary.receive_buffer / limit, 1, False),
    ]


def thread(quick: bool, folder: Path) -> BenchmarkResult:
    """Measure beside a Python thread that computes in the receiver's process; print."""
    rows = []
    print(f"\n{SIZE} bytes, a thread that computes in the receiver's process, medians in ms:")
    for what, receiver, options, environment in (
        ("library, no such thread", "library", (), {}),
        ("library", "library", ("--busy-thread",), {}),
        ("library, a datagram at a time", "library", ("--busy-thread",), PLAIN),
        ("ROS node, no such thread", "node", (), {}),
        ("ROS node", "node", ("--busy-thread",), {}),
    ):
        with closing(UdpBridge(receiver, *options, environment=environment)) as ours:
            took = [ours.send(SIZE) for _ in range(_WARM_UP + (3 if quick else 21))][_WARM_UP:]
        rows.append({"what": what, "ms": statistics.median(took), "count": len(took)})
        print(f"{what:30} {rows[-1]['ms']:8.2f}", flush=True)
    return BenchmarkResult(rows, [])
