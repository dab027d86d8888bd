# SPDX-License-Identifier: Apache-2.0
"""Delivery rates of the repair modes over lossy links: `python -m benchmarks.repair`.

Links and times are simulated and seeded, so the counts are the same on every machine. Only
`--latency` uses processes, sockets and the wall clock: it runs the part `resending` of the bridge
benchmark.
"""

import argparse
import random
from collections.abc import Callable
from pathlib import Path

from tests.udp_bridge.simulated import MS, SECOND, Loss, Simulation, bursts, independent, no_loss
from udp_bridge import Message
from udp_bridge.sender.repair import Fec, Mode, Resend

from .bridge import resending

PARTS = 64
PART = 232
TOPIC = (1, "/p")
HALF = Resend(SECOND // 2)
ROWS: list[tuple[str, Mode | None, Callable[[int], Loss], bool]] = [
    ("none, 1 %", None, lambda seed: independent(random.Random(seed), 0.01), False),
    ("fec 20 %, 5 %", Fec(0.2), lambda seed: independent(random.Random(seed), 0.05), False),
    ("resend 0.5 s, 10 %", HALF, lambda seed: independent(random.Random(seed), 0.1), True),
    (
        "resend 0.5 s, bursts of 5, 5 %",
        HALF,
        lambda seed: bursts(random.Random(seed), 0.05, 5),
        True,
    ),
    (
        "resend 0.2 s, 10 %",
        Resend(SECOND // 5),
        lambda seed: independent(random.Random(seed), 0.1),
        True,
    ),
]


def delivered(mode: Mode | None, make: Callable[[int], Loss], back: bool, count: int) -> str:
    """Return the figures of a table row.

    The run sends `count` messages of 64 parts, ten per second, with a delay of 10 ms each way.
    """
    sim = Simulation(
        repair={TOPIC: mode} if mode else None,
        loss=make(1),
        loss_back=make(2) if back else no_loss,
        delay=10 * MS,
        datagram=256,
    )
    # The payload of a coded part is a multiple of 8 bytes.
    size = PARTS * (PART if not isinstance(mode, Fec) else PART - 8) - 5
    bodies = [random.Random(index).randbytes(size) for index in range(4)]
    wrong = 0
    for index in range(count):
        sim.send(index * 100 * MS, Message(*TOPIC, "l", index * 100 * MS, 0, bodies[index % 4]))
    ages = []
    for _ in range(0, count, 100):
        sim.run(sim.now + 10 * SECOND)
        wrong += sum(message.body != bodies[message.seq_number % 4] for _, message in sim.delivered)
        ages += [when - message.stamp_nanos for when, message in sim.delivered]
        sim.delivered.clear()
    sim.run(sim.now + 2 * SECOND)
    wrong += sum(message.body != bodies[message.seq_number % 4] for _, message in sim.delivered)
    ages += [when - message.stamp_nanos for when, message in sim.delivered]
    ages.sort()
    times = [ages[len(ages) * percent // 100] / MS for percent in (50, 99)] if ages else [0, 0]
    return (
        f"{len(ages)} of {count} ({100 * len(ages) / count:.3f} %), {wrong} wrong, "
        f"age p50 {times[0]:.0f} ms, p99 {times[1]:.0f} ms, "
        f"{sim.sent_datagrams / count / PARTS:.2f} datagrams a part"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description="Measure delivery rates over lossy links.")
    parser.add_argument("--messages", type=int, default=2000, help="of each row (2000)")
    parser.add_argument("--latency", action="store_true", help="measure over sockets instead")
    options = parser.parse_args()
    if not options.latency:
        for name, mode, make, back in ROWS:
            print(f"{name}: {delivered(mode, make, back, options.messages)}", flush=True)
        return
    print("", *resending.run(False, Path()).claims, sep="\n")


if __name__ == "__main__":
    main()
