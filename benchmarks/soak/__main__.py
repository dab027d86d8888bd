# SPDX-License-Identifier: Apache-2.0
"""Soak test of the bridge with loss, duplicates and restarts of both ends.

    .venv/bin/python -m benchmarks.soak --minutes 10

Two processes communicate through a relay that loses and repeats datagrams both ways and counts what
it passes on. First each process is killed once while data flow. After that only their links are
replaced, with and without last reports, so that the memory of a process shows what a closed link
leaves behind. At intervals traffic stops until nothing is in flight, and the sender's delivery
counts are compared with the relay's.
"""

import argparse
import itertools
import statistics
import sys
import threading
import time
from collections import Counter
from typing import NamedTuple

from udp_bridge.sender.delivery_counts import DeliveryCounts

from .endpoints import (
    LOCAL,
    RECEIVED,
    REPAIR,
    TOPICS,
    EndpointProcess,
    ReceivingEndpoint,
    SendingEndpoint,
)
from .lossy_relay import LossyRelay, ReferenceCounts

LOSS = DUPLICATES = 0.02
REPORT_SECONDS = 2.5
"""Messages received within this time before a crash may never be reported: reports are sent once a
second, and one may be lost."""
DRAIN_SECONDS = 12.0
"""Longest time until nothing is in flight: 2 s until the receiver gives up, 4 s until settled."""
WARM_UP = 0.3
"""Share of the time in which memory may grow, because buffers are allocated on first use."""
FLAT_KB_PER_MINUTE = 150.0
"""Largest accepted slope of resident memory: 1 MB in 7 minutes, the noise of the heap."""
MINIMUM_MINUTES = 10.0
"""In a shorter test the heap's steps look like a slope."""


class Sample(NamedTuple):
    """Resident memory of an endpoint."""

    end: str
    seconds: float
    kb: float


class Soak:
    """Both endpoints and the relay between them."""

    def __init__(self, seed: int) -> None:
        self.faults: list[str] = []
        self.kills = 0
        self.restarts = 0
        self.drains = 0
        self.totals: Counter[str] = Counter()
        self.memory: list[Sample] = []
        self.reference = ReferenceCounts()
        self._begun = time.monotonic()
        self._receiver = EndpointProcess(ReceivingEndpoint, self._on_report)
        self._receiver_at = self._receiver.call("open", LOCAL)
        self.relay = LossyRelay(self._receiver_at, seed, loss=LOSS, duplicates=DUPLICATES)
        self._sender = EndpointProcess(SendingEndpoint, self._on_report)
        self._sender_at = LOCAL
        self._open_sender()
        self.relay.reset(self.reference)

    def send_for(self, seconds: float) -> None:
        """Send every topic at its rate."""
        self._sender.call_async("send_for", seconds)
        self._sent()

    def kill_receiver(self, seconds: float) -> None:
        """Kill the receiver's process while data flow and start another one."""
        self._sender.call_async("send_for", seconds)
        time.sleep(seconds / 2)
        self._receiver.kill()
        self.reference.crashes += 1
        self.reference.receivers += 1
        self.kills += 1
        self._receiver = EndpointProcess(ReceivingEndpoint, self._on_report)
        self._receiver.call("open", self._receiver_at)
        self._sent()

    def kill_sender(self, seconds: float) -> None:
        """Kill the sender's process while data flow and start another one."""
        self._sender.call_async("send_for", seconds)
        time.sleep(seconds / 2)
        self._sender.kill()
        self.kills += 1
        self._sender = EndpointProcess(SendingEndpoint, self._on_report)
        self._start_incarnation()

    def crash_receiver(self, seconds: float) -> None:
        """Replace the receiver's link without last reports."""
        self.reference.crashes += 1
        self.restart_receiver(seconds, is_crash=True)

    def restart_receiver(self, seconds: float, *, is_crash: bool = False) -> None:
        """Replace the receiver's link while data flow."""
        self.reference.receivers += 1
        self._sender.call_async("send_for", seconds)
        time.sleep(seconds / 2)
        self._receiver.call("restart", is_crash=is_crash)
        self.restarts += 1
        self._sent()

    def restart_sender(self, seconds: float) -> None:
        """Replace the sender's link with data in flight."""
        self.send_for(seconds)
        for counts in self._counts():
            self._check_bounds(counts)
        self._sender.call("close")
        self.restarts += 1
        self._start_incarnation()

    def drain(self, seconds: float) -> None:
        """Send, wait until nothing is in flight, then compare counts and reference."""
        self.send_for(seconds)
        self._sender.call("flush")
        end = time.monotonic() + DRAIN_SECONDS
        while any(counts.in_flight for counts in self._counts()) and time.monotonic() < end:
            time.sleep(0.2)
        self.relay.settle()
        self._receiver.call("ping")
        self.drains += 1
        for counts in self._counts():
            self._check_bounds(counts)
            self._check_exactly(counts)

    def sample(self) -> None:
        """Record the memory of both processes, except one that was just killed."""
        seconds = time.monotonic() - self._begun
        for name, end in (("sender", self._sender), ("receiver", self._receiver)):
            try:
                kb = end.resident_kb()
            except (OSError, IndexError):
                continue
            if kb:  # a process that was killed has none
                self.memory.append(Sample(name, seconds, kb))

    def close(self) -> None:
        """End everything."""
        self._sender.kill()
        self._receiver.kill()
        self.relay.close()

    def _start_incarnation(self) -> None:
        self._incarnation = 0  # late messages of the old one are ignored
        self.relay.settle()
        self.reference = ReferenceCounts()
        self.relay.reset(self.reference)
        time.sleep(1.0)  # like a process; `resend` distinguishes restarts by their stamps
        self._open_sender()

    def _open_sender(self) -> None:
        self._incarnation = time.time_ns()
        to = self.relay.front.getsockname()
        self._sender_at = self._sender.call("open", self._sender_at, to, self._incarnation)

    def _sent(self) -> None:
        self.reference.sent.update(self._sender.result())

    def _on_report(self, what: str, *rest: object) -> None:
        if what != RECEIVED:
            self.faults.append(str(rest[0]))
            return
        incarnation, number, msg_type, topic = rest
        # A restarted receiver may request messages again.
        if incarnation == self._incarnation and number not in self.reference.seen:
            assert isinstance(number, int)
            assert isinstance(msg_type, int)
            self.reference.seen.add(number)
            self.reference.delivered[msg_type, str(topic)] += 1

    def _counts(self) -> list[DeliveryCounts]:
        counts: list[DeliveryCounts] = self._sender.call("delivery_counts")
        return counts

    def _check_bounds(self, counts: DeliveryCounts) -> None:
        """Check the invariants that hold with messages in flight and after restarts."""
        key = (counts.msg_type, counts.topic)
        lost = counts.dropped + counts.incomplete + counts.late + counts.missing
        total = counts.delivered + lost + counts.in_flight
        self._expect(counts, "the sum is what was sent", total, counts.sent)
        asked = counts.sent + counts.superseded
        self._expect(
            counts,
            "sends only what was requested",
            max(asked, self.reference.sent[key]),
            self.reference.sent[key],
        )
        negative = [count for count in counts[2:-1] if isinstance(count, int) and count < 0]
        self._expect(counts, "no count is negative", negative, [])

    def _check_exactly(self, counts: DeliveryCounts) -> None:
        """Check what holds at rest; where receivers ended, but for what they did not report."""
        key = (counts.msg_type, counts.topic)
        self._expect(counts, "nothing is in flight", counts.in_flight, 0)
        asked = counts.sent + counts.superseded
        self._expect(counts, "everything was sent or superseded", asked, self.reference.sent[key])
        real = self.reference.delivered[key]
        for name in ("sent", "delivered", "missing", "incomplete", "late", "dropped", "repaired"):
            self.totals[name] += getattr(counts, name)
        if self.reference.receivers:
            period = next(row[2] for row in TOPICS if row[1] == counts.topic)
            unreported = int(REPORT_SECONDS / period) * self.reference.crashes
            self.totals["unreported"] += real - counts.delivered
            if not 0 <= real - counts.delivered <= unreported:
                self.faults.append(f"{key}: {counts.delivered} delivered, in truth {real}")
            return
        if key in REPAIR:  # what came too late for its limit may have come whole
            self._expect(counts, "delivered", counts.delivered, real)
            return
        never = counts.sent - self.reference.whole[key] - self.reference.partial[key]
        self._expect(counts, "delivered", counts.delivered, real)
        self._expect(counts, "whole", counts.delivered + counts.late, self.reference.whole[key])
        self._expect(counts, "incomplete", counts.incomplete, self.reference.partial[key])
        self._expect(counts, "missing", counts.missing, never)

    def _expect(self, counts: DeliveryCounts, what: str, got: object, expected: object) -> None:
        if got != expected:
            self.faults.append(f"{counts.topic}: {what}: {got} instead of {expected}; {counts}")


def soak(minutes: float, seed: int) -> Soak:
    """Run for about `minutes`; return what was found."""
    begun = time.monotonic()
    end = begun + 60 * minutes
    step = min(10.0, max(1.0, 60 * minutes / 6))
    run = Soak(seed)
    is_over = threading.Event()

    def watch() -> None:
        while not is_over.wait(1.0):
            run.sample()

    watching = threading.Thread(target=watch)
    watching.start()
    # No restart in the first incarnation until its counts were compared exactly.
    first = (run.drain, run.kill_receiver, run.kill_sender)
    then = (run.drain, run.restart_receiver, run.restart_sender, run.crash_receiver)
    try:
        for turn in first:
            turn(step)
        for turn in itertools.cycle(then):
            if time.monotonic() >= end:
                break
            turn(step)
        run.restart_sender(step)
        run.restart_receiver(step)
        run.drain(step)
    finally:
        is_over.set()
        watching.join()
        run.close()
    return run


def check_memory(memory: list[Sample], minutes: float) -> tuple[list[str], list[str]]:
    """Return a line about the memory of each endpoint, and one about each that grows.

    It has to be flat: the slope is that of a least-squares line after the warm-up.
    """
    lines, growing = [], []
    for end in sorted({row.end for row in memory}):
        samples = [(row.seconds, row.kb) for row in memory if row.end == end]
        settled = [row for row in samples if row[0] >= WARM_UP * samples[-1][0]]
        slope = 60 * statistics.linear_regression(*zip(*settled, strict=True)).slope
        if minutes >= MINIMUM_MINUTES and slope > FLAT_KB_PER_MINUTE:
            growing.append(f"{end}: memory grows by {slope:.0f} kB a minute")
        sizes = [kb / 1024 for _, kb in settled]
        third = max(1, len(sizes) // 3)
        seconds = settled[-1][0] - settled[0][0]
        lines.append(
            f"memory of the {end}: {slope:+.1f} kB a minute over {seconds:.0f} s; "
            f"{min(sizes):.1f} to {max(sizes):.1f} MB, in the first third "
            f"{sum(sizes[:third]) / third:.2f} MB, in the last {sum(sizes[-third:]) / third:.2f} MB"
        )
    return lines, growing


def main() -> int:
    """Soak, print what was found; 0 when all sums add up and memory is flat."""
    parser = argparse.ArgumentParser(prog="benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    run = soak(options.minutes, options.seed)
    totals = ", ".join(f"{name} {count}" for name, count in run.totals.items())
    print(f"relay: {run.relay.lost} datagrams lost, {run.relay.repeated} repeated")
    print(f"{run.kills} kills, {run.restarts} restarts, {run.drains} comparisons: {totals}")
    lines, growing = check_memory(run.memory, options.minutes)
    run.faults += growing
    print("\n".join(lines))
    for fault in run.faults[:20]:
        print(f"fault: {fault}")
    print("every sum adds up" if not run.faults else f"{len(run.faults)} faults")
    return 1 if run.faults else 0


if __name__ == "__main__":
    sys.exit(main())
