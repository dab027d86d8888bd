# SPDX-License-Identifier: Apache-2.0
"""A soak of the bridge: loss, duplicates, restarts of both ends; flat memory, sums that add up.

    .venv/bin/python -m benchmarks.soak --minutes 10

Two processes talk through a relay that loses and repeats datagrams both ways and keeps its own
books of what it let through. At first both are killed once while data flow. From then on only
their links are ended and made anew, with and without a last word, so that a process's memory shows
whatever an ended link leaves behind. Now and then traffic rests until nothing is in flight, and
the sender's accounts are compared with the books.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import threading
import time
from collections import Counter

from udp_bridge.sender.delivery_counts import DeliveryCounts

from .endpoints import LOCAL, REPAIR, TOOK, TOPICS, End, Receiver, Sender
from .lossy_relay import Books, Relay
from .memory import Sample, judged

LOSS = DUPLICATES = 0.02
REPORT_SECONDS = 2.5
"""What a receiver took within this time before its end may never be reported: it tells once a
second, and one report may be lost."""
REST_SECONDS = 12.0
"""How long everything may be in flight at most: 2 s of patience, 4 s until it is settled."""


class Soak:
    """Both ends and the relay between them."""

    def __init__(self, seed: int) -> None:
        self.faults: list[str] = []
        self.kills = 0
        self.restarts = 0
        self.rests = 0
        self.totals: Counter[str] = Counter()
        self.memory: list[Sample] = []
        self.books = Books()
        self._begun = time.monotonic()
        self._receiver = End(Receiver, self._told)
        self._receiver_at = self._receiver.do("open", LOCAL)
        self.relay = Relay(self._receiver_at, seed, loss=LOSS, duplicates=DUPLICATES)
        self._sender = End(Sender, self._told)
        self._sender_at = LOCAL
        self._open_sender()
        self.relay.new_life(self.books)

    def send_for(self, seconds: float) -> None:
        """Send every topic at its rate."""
        self._sender.begin("send_for", seconds)
        self._sent()

    def kill_receiver(self, seconds: float) -> None:
        """Kill the receiver's process in the midst of data and start another one."""
        self._sender.begin("send_for", seconds)
        time.sleep(seconds / 2)
        self._receiver.kill()
        self.books.crashes += 1
        self.books.receivers += 1
        self.kills += 1
        self._receiver = End(Receiver, self._told)
        self._receiver.do("open", self._receiver_at)
        self._sent()

    def kill_sender(self, seconds: float) -> None:
        """Kill the sender's process in the midst of data and start another one."""
        self._sender.begin("send_for", seconds)
        time.sleep(seconds / 2)
        self._sender.kill()
        self.kills += 1
        self._sender = End(Sender, self._told)
        self._new_life()

    def crash_receiver(self, seconds: float) -> None:
        """End the receiver's link without a last word and make another one."""
        self.books.crashes += 1
        self.restart_receiver(seconds, is_crash=True)

    def restart_receiver(self, seconds: float, *, is_crash: bool = False) -> None:
        """End the receiver's link in the midst of data and make another one."""
        self.books.receivers += 1
        self._sender.begin("send_for", seconds)
        time.sleep(seconds / 2)
        self._receiver.do("restart", is_crash=is_crash)
        self.restarts += 1
        self._sent()

    def restart_sender(self, seconds: float) -> None:
        """End the sender's link without a word, with data in flight, and make another one."""
        self.send_for(seconds)
        for account in self._accounts():
            self._check_bounds(account)
        self._sender.do("close")
        self.restarts += 1
        self._new_life()

    def rest(self, seconds: float) -> None:
        """Send, wait until nothing is in flight, then compare accounts and books."""
        self.send_for(seconds)
        self._sender.do("flush")
        end = time.monotonic() + REST_SECONDS
        while any(account.in_flight for account in self._accounts()) and time.monotonic() < end:
            time.sleep(0.2)
        self.relay.settle()
        self._receiver.do("nothing")
        self.rests += 1
        for account in self._accounts():
            self._check_bounds(account)
            self._check_exactly(account)

    def sample(self) -> None:
        """Write down the memory of both ends, but for what was just killed."""
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

    def _new_life(self) -> None:
        self._life = 0  # what still comes of the old one belongs to no books
        self.relay.settle()
        self.books = Books()
        self.relay.new_life(self.books)
        time.sleep(1.0)  # as long as a process takes; `resend` tells lives apart by their stamps
        self._open_sender()

    def _open_sender(self) -> None:
        self._life = time.time_ns()
        to = self.relay.front.getsockname()
        self._sender_at = self._sender.do("open", self._sender_at, to, self._life)

    def _sent(self) -> None:
        self.books.sent.update(self._sender.answer())

    def _told(self, what: str, *rest: object) -> None:
        if what != TOOK:
            self.faults.append(str(rest[0]))
            return
        life, number, msg_type, topic = rest
        # The successor of a receiver may ask for what that one had.
        if life == self._life and number not in self.books.seen:
            assert isinstance(number, int)
            assert isinstance(msg_type, int)
            self.books.seen.add(number)
            self.books.delivered[msg_type, str(topic)] += 1

    def _accounts(self) -> list[DeliveryCounts]:
        accounts: list[DeliveryCounts] = self._sender.do("delivery_counts")
        return accounts

    def _check_bounds(self, account: DeliveryCounts) -> None:
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

    def _check_exactly(self, account: DeliveryCounts) -> None:
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

    def _expect(self, account: DeliveryCounts, what: str, got: object, expected: object) -> None:
        if got != expected:
            self.faults.append(f"{account.topic}: {what}: {got} instead of {expected}; {account}")


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
    # In the first life nothing is restarted until the books were compared to the last one.
    first = (run.rest, run.kill_receiver, run.kill_sender)
    then = (run.rest, run.restart_receiver, run.restart_sender, run.crash_receiver)
    try:
        for turn in first:
            turn(step)
        for turn in itertools.cycle(then):
            if time.monotonic() >= end:
                break
            turn(step)
        run.restart_sender(step)
        run.restart_receiver(step)
        run.rest(step)
    finally:
        is_over.set()
        watching.join()
        run.close()
    return run


def main() -> int:
    """Soak, print what was found; 0 when all sums add up and memory is flat."""
    parser = argparse.ArgumentParser(prog="benchmarks.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    run = soak(options.minutes, options.seed)
    totals = ", ".join(f"{name} {count}" for name, count in run.totals.items())
    print(f"relay: {run.relay.lost} datagrams lost, {run.relay.repeated} repeated")
    print(f"{run.kills} kills, {run.restarts} restarts, {run.rests} comparisons: {totals}")
    lines, growing = judged(run.memory, options.minutes)
    run.faults += growing
    print("\n".join(lines))
    for fault in run.faults[:20]:
        print(f"fault: {fault}")
    print("every sum adds up" if not run.faults else f"{len(run.faults)} faults")
    return 1 if run.faults else 0


if __name__ == "__main__":
    sys.exit(main())
