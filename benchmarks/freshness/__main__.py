# SPDX-License-Identifier: Apache-2.0
"""Age of data at the end of a lossy link, UDP Bridge and TCP: `python -m benchmarks.freshness`.

1 MB is sent ten times a second over an emulated link with 5 % loss and 10 ms delay each way. The
link is the project's relay for datagrams, or IP packets between two network namespaces, used by the
kernel's TCP and by UDP Bridge. A loss costs TCP more the smaller its packets are, so it is measured
with Ethernet's and with the largest packets, and with CUBIC, Linux's default congestion control,
and BBR, which mostly ignores random loss. UDP Bridge sends 1 MB as four messages over Ethernet's
packets, because it does not fit into 255 of them; a single message would cause IP fragments.
"""

import argparse
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import NamedTuple

from groundlink.emulation.settings import Impairment
from udp_bridge.sender.repair import parse_mode
from udp_bridge.wire.fragments import DatagramSize

from . import bridge_ages, tcp_ages
from .bridge_ages import Traffic
from .tcp_ages import Arrival
from .two_hosts import NotAllowed

PICTURE = Path(__file__).parents[2] / "docs" / "pictures" / "freshness.png"
LINK = Impairment(loss=0.05, delay_ms=10)
SIZE = 1_000_000
RATE_HZ = 10.0
ETHERNET_MTU, LARGEST_MTU = 1500, 65_535
BLOCKS = 4
"""Of 250 kB, which fit into 255 datagrams of an Ethernet packet each; 1 MB does not."""
SAMPLE_NANOS = 5_000_000
WORSE_AT_LEAST = 20.0


class TransportAges(NamedTuple):
    """Ages of one transport in milliseconds."""

    name: str
    delivered: int
    ages_ms: list[float]
    """Of the received messages, sorted."""
    newest_ms: list[float]
    """Age of the newest message at the receiver, sampled continuously and sorted; losses count."""


def result(name: str, arrivals: list[Arrival], seconds: float) -> TransportAges:
    """Return the ages of the received messages, from the first arrival until the sender stops."""
    rows = sorted(arrivals, key=lambda row: row.at_nanos)
    if not rows:
        return TransportAges(name, 0, [], [])
    end = rows[0].stamp_nanos + round((seconds - 1 / RATE_HZ) * 1e9)
    newest = []
    stamp, index = rows[0].stamp_nanos, 0
    for now in range(rows[0].at_nanos, end, SAMPLE_NANOS):
        while index < len(rows) and rows[index].at_nanos <= now:
            stamp = max(stamp, rows[index].stamp_nanos)
            index += 1
        newest.append((now - stamp) / 1e6)
    ages = sorted((row.at_nanos - row.stamp_nanos) / 1e6 for row in rows)
    return TransportAges(name, len(rows), ages, sorted(newest))


def at(values: list[float], share: float) -> float:
    """Return the value that so many do not exceed."""
    return values[min(len(values) - 1, int(share * len(values)))] if values else float("inf")


def ways(seconds: float) -> dict[str, Callable[[], list[Arrival]]]:
    """Return every way to send by its name; the first is the one that is compared."""

    def ours(
        mode: object, datagram: DatagramSize = "loopback", blocks: int = 1
    ) -> Callable[[], list[Arrival]]:
        traffic = Traffic(SIZE, RATE_HZ, seconds, datagram, parse_mode(mode), blocks)
        if datagram == "loopback":
            return partial(bridge_ages.measure, LINK, traffic)
        return partial(bridge_ages.measure_packets, LINK, traffic, mtu=ETHERNET_MTU)

    def tcp(congestion: str, mtu: int) -> Callable[[], list[Arrival]]:
        return partial(
            tcp_ages.measure,
            LINK,
            size=SIZE,
            rate_hz=RATE_HZ,
            seconds=seconds,
            congestion=congestion,
            mtu=mtu,
        )

    return {
        "UDP Bridge, fec 20 %": ours({"fec": 0.2}),
        "UDP Bridge, resend": ours("resend"),
        "UDP Bridge, no repair": ours("none"),
        "UDP Bridge, fec 20 %, Ethernet": ours({"fec": 0.2}, "mtu", BLOCKS),
        "UDP Bridge, resend, Ethernet": ours("resend", "mtu", BLOCKS),
        "UDP Bridge, resend, IP fragments": ours("resend", "mtu"),
        "TCP, CUBIC, Ethernet": tcp("cubic", ETHERNET_MTU),
        "TCP, CUBIC, 64 kB packets": tcp("cubic", LARGEST_MTU),
        "TCP, BBR, Ethernet": tcp("bbr", ETHERNET_MTU),
    }


COMPARED = (
    ("UDP Bridge, fec 20 %", "TCP, CUBIC, Ethernet"),
    ("UDP Bridge, fec 20 %, Ethernet", "TCP, CUBIC, Ethernet"),
)
"""The ways for which TCP is to be as much worse as claimed: datagrams of 64 kB against TCP's own
packets, each of which is one loss to its link, and both over the very same network."""


def _compared(ours: TransportAges, theirs: TransportAges) -> float:
    """Print how much older TCP is at p99; return it for what arrived."""
    ratio = at(theirs.ages_ms, 0.99) / at(ours.ages_ms, 0.99)
    newest = at(theirs.newest_ms, 0.99) / at(ours.newest_ms, 0.99)
    print(f"{theirs.name} is {ratio:.0f} times older at p99 than {ours.name}, ", end="")
    print(f"its newest {newest:.0f} times")
    return ratio


def draw(results: list[TransportAges], path: Path) -> None:
    """Draw which share of the time the newest data were older than an age."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(10, 4.5), constrained_layout=True)
    for row in results:
        style = "-" if row.name.startswith("UDP") else "--"
        shares = [1 - index / len(row.newest_ms) for index in range(len(row.newest_ms))]
        axes.plot(row.newest_ms, shares, style, label=row.name)
    axes.set(
        xscale="log",
        yscale="log",
        ylim=(0.005, 1.05),
        xlabel="age of the newest data at the receiver in ms",
        ylabel="share of the time in which it was older",
        title="1 MB at 10 Hz over a link that loses 5 % and takes 10 ms each way",
    )
    axes.grid(visible=True, which="both", alpha=0.3)
    figure.legend(loc="outside right upper")
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def main() -> int:
    """Measure, print the table, draw the picture; 1 when TCP is not as much worse as claimed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.freshness")
    parser.add_argument("--seconds", type=float, default=30.0, help="for each way")
    parser.add_argument("--picture", type=Path, default=PICTURE)
    arguments = parser.parse_args()
    messages = round(arguments.seconds * RATE_HZ)
    print(f"{'':32} delivered   age p50        p99    newest p50        p99")
    results = {}
    for name, measure in ways(arguments.seconds).items():
        try:
            row = result(name, measure(), arguments.seconds)
        except (NotAllowed, OSError) as error:
            print(f"{name:32} not measured: {error}", flush=True)
            continue
        results[name] = row
        ages = (
            at(values, share) for values in (row.ages_ms, row.newest_ms) for share in (0.5, 0.99)
        )
        columns = " ".join(f"{age:9.1f} ms" for age in ages)
        print(f"{name:32} {row.delivered:4} of {messages:3} {columns}", flush=True)
    ratios = [
        _compared(results[ours], results[theirs])
        for ours, theirs in COMPARED
        if ours in results and theirs in results
    ]
    if len(ratios) < len(COMPARED):
        return 2
    draw(list(results.values()), arguments.picture)
    print(f"drawn: {arguments.picture}")
    return 0 if min(ratios) >= WORSE_AT_LEAST else 1


if __name__ == "__main__":
    sys.exit(main())
