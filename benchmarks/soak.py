# SPDX-License-Identifier: Apache-2.0
"""A soak of the bridge: loss, duplicates, restarts of both ends; flat memory, sums that add up.

    .venv/bin/python -m benchmarks.soak --minutes 10

Two links of one process talk through a relay that loses and repeats datagrams both ways and keeps
its own books of what it let through. Ends are restarted without a word, in turn; now and then
traffic rests until nothing is in flight, and the sender's accounts are compared with the books.
"""

from __future__ import annotations

import argparse
import gc
import os
import struct
import sys
import time
import zlib
from collections import Counter

from udp_bridge import Link, Message
from udp_bridge.accounts import Account
from udp_bridge.repair import Resend
from udp_bridge.types import MSG_TYPES

from .lossy_relay import Books, Relay

LOCAL = ("127.0.0.1", 0)
LOSS = DUPLICATES = 0.02
DATAGRAM = 8192
TOPICS = (
    (2, "/imu", 0.005, 320),
    (5, "/wheels", 0.02, 200),
    (1, "/points", 0.1, 200_000),
    (33, "/image", 0.1, 100_000),
)
"""Type, topic, period in s, bytes of a body."""
REPAIR = {(33, "/image"): Resend(500_000_000)}
REPORT_SECONDS = 1.5
"""What a receiver took within this time before its end may never be reported."""
REST_SECONDS = 12.0
"""How long everything may be in flight at most: 2 s of patience, 4 s until it is settled."""
_TAG = struct.Struct("<QQI")


class Soak:
    """Both ends and the relay between them."""

    def __init__(self, seed: int) -> None:
        self.faults: list[str] = []
        self.restarts = 0
        self.rests = 0
        self.totals: Counter[str] = Counter()
        self._number = 0
        self.books = Books()
        self.wrong: list[str] = []
        self._receiver = Link(LOCAL, on_message=self._take, report=True)
        self._receiver_at = self._receiver.address
        self.relay = Relay(self._receiver_at, seed, loss=LOSS, duplicates=DUPLICATES)
        self._sender = self._new_sender(LOCAL)
        self._sender_at = self._sender.address
        self.relay.new_life(self.books)

    def send_for(self, seconds: float) -> None:
        """Send every topic at its rate."""
        begun = time.monotonic()
        due = {topic: begun for _, topic, _, _ in TOPICS}
        while (now := time.monotonic()) < begun + seconds:
            for msg_type, topic, period, size in TOPICS:
                if now >= due[topic]:
                    due[topic] += period
                    self._sender.send(msg_type, topic, "", time.time_ns(), self._body(size))
                    self.books.sent[msg_type, topic] += 1
            time.sleep(max(0.0, min(due.values()) - time.monotonic()))

    def crash_receiver(self) -> None:
        """End the receiver without a last word and start another one in its place."""
        self._receiver._report = False
        self.books.crashes += 1
        self.restart_receiver()

    def restart_receiver(self) -> None:
        """End the receiver and start another one in its place."""
        self._receiver.close()
        self._receiver = Link(self._receiver_at, on_message=self._take, report=True)
        self.books.receivers += 1
        self.restarts += 1

    def restart_sender(self) -> None:
        """End the sender without a word and start another one in its place."""
        for account in self._accounts():
            self._check_bounds(account)
        self._sender.close()
        self.restarts += 1
        self.relay.settle()
        self.books = Books()
        self.relay.new_life(self.books)
        time.sleep(1.0)  # as long as a process takes; `resend` tells lives apart by their stamps
        self._sender = self._new_sender(self._sender_at)

    def rest(self) -> None:
        """Wait until nothing is in flight, then compare accounts and books."""
        self._sender.flush(5.0)
        end = time.monotonic() + REST_SECONDS
        while any(account.in_flight for account in self._accounts()) and time.monotonic() < end:
            time.sleep(0.2)
        self.relay.settle()
        self.rests += 1
        for account in self._accounts():
            self._check_bounds(account)
            self._check_exactly(account)

    def close(self) -> None:
        """End everything."""
        self._sender.close()
        self._receiver.close()
        self.relay.close()
        self.faults += self.wrong

    def _new_sender(self, bind: tuple[str, int]) -> Link:
        self._life = time.time_ns()
        return Link(bind, self.relay.front.getsockname(), datagram=DATAGRAM, repair=REPAIR)

    def _body(self, size: int) -> bytes:
        self._number += 1
        rest = self._number.to_bytes(8, "little") * (size // 8)
        return _TAG.pack(self._life, self._number, zlib.crc32(rest)) + rest

    def _take(self, message: Message, sender: object) -> None:
        if not MSG_TYPES[message.msg_type].ros_type:
            return
        body = memoryview(message.body)
        life, number, crc = _TAG.unpack_from(body)
        if zlib.crc32(body[_TAG.size :]) != crc:
            self.wrong.append(f"{message}: not what was sent")
        # The successor of a receiver may ask for what that one had.
        if life == self._life and number not in self.books.seen:
            self.books.seen.add(number)
            self.books.delivered[message.msg_type, message.topic] += 1

    def _accounts(self) -> list[Account]:
        return self._sender.accounts()

    def _check_bounds(self, account: Account) -> None:
        """Check what always holds, whatever is in flight and whoever was restarted."""
        key = (account.msg_type, account.topic)
        lost = account.dropped + account.incomplete + account.late + account.missing
        total = account.delivered + lost + account.in_flight
        self._expect(account, "the sum is what was sent", total, account.sent)
        asked = account.sent + account.superseded
        self._expect(
            account,
            "no more sent than asked for",
            max(asked, self.books.sent[key]),
            self.books.sent[key],
        )
        negative = [count for count in account[2:-1] if isinstance(count, int) and count < 0]
        self._expect(account, "no count is negative", negative, [])

    def _check_exactly(self, account: Account) -> None:
        """Check what holds at rest; where receivers ended, but for what they did not report."""
        key = (account.msg_type, account.topic)
        self._expect(account, "nothing is in flight", account.in_flight, 0)
        asked = account.sent + account.superseded
        self._expect(account, "everything was sent or superseded", asked, self.books.sent[key])
        real = self.books.delivered[key]
        for name in ("sent", "delivered", "missing", "incomplete", "late", "dropped", "repaired"):
            self.totals[name] += getattr(account, name)
        if self.books.receivers:
            period = next(row[2] for row in TOPICS if row[1] == account.topic)
            unreported = int(REPORT_SECONDS / period) * self.books.crashes
            self.totals["unreported"] += real - account.delivered
            if not 0 <= real - account.delivered <= unreported:
                self.faults.append(f"{key}: {account.delivered} delivered, in truth {real}")
            return
        if key in REPAIR:  # what came too late for its limit may have come whole
            self._expect(account, "delivered", account.delivered, real)
            return
        never = account.sent - self.books.whole[key] - self.books.partial[key]
        self._expect(account, "delivered", account.delivered, real)
        self._expect(account, "whole", account.delivered + account.late, self.books.whole[key])
        self._expect(account, "incomplete", account.incomplete, self.books.partial[key])
        self._expect(account, "missing", account.missing, never)

    def _expect(self, account: Account, what: str, got: object, expected: object) -> None:
        if got != expected:
            self.faults.append(f"{account.topic}: {what}: {got} instead of {expected}; {account}")


def resident_kb() -> float:
    """Return the memory of this process that is resident."""
    with open("/proc/self/statm", encoding="ascii") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1024


def slope_kb_per_minute(samples: list[tuple[float, float]]) -> float:
    """Return the slope of the line nearest to (seconds, kB), by least squares."""
    mean_s = sum(s for s, _ in samples) / len(samples)
    mean_kb = sum(kb for _, kb in samples) / len(samples)
    spread = sum((s - mean_s) ** 2 for s, _ in samples)
    if not spread:
        return 0.0
    return 60 * sum((s - mean_s) * (kb - mean_kb) for s, kb in samples) / spread


def soak(minutes: float, seed: int) -> tuple[Soak, list[tuple[float, float]]]:
    """Run for about `minutes`; return what was found, and memory by time (s, kB)."""
    begun = time.monotonic()
    end = begun + 60 * minutes
    step = min(10.0, max(1.0, 60 * minutes / 6))
    run = Soak(seed)
    memory = []
    turns = (run.rest, run.restart_receiver, run.restart_sender, run.crash_receiver)
    try:
        for turn in range(sys.maxsize):
            run.send_for(step)
            # In the first life nothing is restarted until the books were compared to the last one.
            turns[turn % 4]()
            if turn % 4 != 0:
                run.send_for(step)
            gc.collect()  # ended links wait for it, and would hide a leak in their noise
            memory.append((time.monotonic() - begun, resident_kb()))
            if time.monotonic() >= end:
                break
        run.restart_sender()
        run.send_for(step)
        run.restart_receiver()
        run.send_for(step)
        run.rest()
    finally:
        run.close()
    return run, memory


def main() -> int:
    """Soak, print what was found; 0 when all sums add up."""
    parser = argparse.ArgumentParser(prog="benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    run, memory = soak(options.minutes, options.seed)
    totals = ", ".join(f"{name} {count}" for name, count in run.totals.items())
    print(f"relay: {run.relay.lost} datagrams lost, {run.relay.repeated} repeated")
    print(f"{run.restarts} restarts, {run.rests} comparisons: {totals}")
    settled = memory[len(memory) // 4 :]
    print(
        f"memory: {settled[0][1] / 1024:.1f} MB, at the end {settled[-1][1] / 1024:.1f} MB, "
        f"{slope_kb_per_minute(settled):+.0f} kB a minute"
    )
    for fault in run.faults[:20]:
        print(f"fault: {fault}")
    print("every sum adds up" if not run.faults else f"{len(run.faults)} faults")
    return 1 if run.faults else 0


if __name__ == "__main__":
    sys.exit(main())
