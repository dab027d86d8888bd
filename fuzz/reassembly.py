# SPDX-License-Identifier: Apache-2.0
"""Whatever datagrams arrive, the receiver raises nothing and stays within its limits.

Run `python fuzz/reassembly.py [--seconds S] [--seed N]`. It mixes random bytes, mutated and
honest datagrams of several senders, and in the end checks that an honest message still passes.
A failure prints the seed that repeats it.
"""

from __future__ import annotations

import argparse
import random
import sys
import time

from udp_bridge import Header, Limits, Message, Reassembler, fragments
from udp_bridge.fragments import DatagramSize

LIMITS = Limits(memory_bytes=1 << 20, senders=8, topics=32)
BATCH = 10_000
SENDERS = 12
SIZES: list[DatagramSize] = [256, "mtu"]


def datagrams(rng: random.Random) -> list[bytes]:
    """Return the datagrams of a message as any sender might send it."""
    header = Header(
        msg_type=rng.choice([1, 2, 7, 8, 64]),
        seq_number=rng.choice([0, 1, 2, 255, 256, 2**31, 2**32 - 1, rng.getrandbits(32)]),
        part_number=0,
        parts_max=1,
        time_sec=rng.choice([0, 1, -(2**31), 2**31 - 1]),
        time_nsec=rng.randrange(10**9),
        topic=rng.choice(["", "/a", "/ż", "/" + "x" * rng.randrange(100)]),
        link=rng.choice(["", "l", "y" * rng.randrange(100)]),
    )
    body = rng.randbytes(rng.choice([0, 1, 12, 40, 72, 300, 3000]))
    message = Message(
        header.msg_type, header.topic, header.link, header.stamp_nanos, header.seq_number, body
    )
    size = rng.choice(SIZES)
    return [head + bytes(part) for head, part in fragments(message, size)]


def mutated(rng: random.Random, datagram: bytes) -> bytes:
    """Return a datagram with a few bytes changed, most of them in the header, or cut short."""
    changed = bytearray(datagram)
    for _ in range(rng.randrange(1, 4)):
        changed[rng.randrange(min(len(changed), rng.choice([18, 300])))] = rng.randrange(256)
    return bytes(changed[: rng.choice([len(changed), rng.randrange(len(changed) + 1)])])


def run_batch(seed: int) -> int:
    """Feed one batch to a fresh receiver; return how many datagrams it refused."""
    rng = random.Random(seed)
    reassembler = Reassembler(LIMITS)
    now_nanos = 0
    fed = 0
    while fed < BATCH:
        arriving = datagrams(rng)
        rng.shuffle(arriving)
        for honest in arriving:
            datagram = rng.choice([honest, mutated(rng, honest), rng.randbytes(rng.randrange(100))])
            now_nanos += rng.choice([0, 1000, 10**7])
            reassembler.receive(datagram, rng.randrange(SENDERS), now_nanos)
            fed += 1
            assert 0 <= reassembler.memory_bytes <= LIMITS.memory_bytes
    known = [len(list(reassembler.tallies(sender))) for sender in range(SENDERS)]
    assert sum(known) <= LIMITS.topics
    assert sum(map(bool, known)) <= LIMITS.senders
    whole = Message(1, "/honest", "", 0, 0, bytes(5000))
    results = [reassembler.receive(b"".join(cut), "honest", now_nanos) for cut in fragments(whole)]
    assert [result is not None for result in results] == [True]
    reassembler.give_up_all()
    assert reassembler.memory_bytes == 0
    return sum(reassembler.counters.refused.values())


def main() -> int:
    """Run batches until the time is over."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    end = time.monotonic() + arguments.seconds
    seed = arguments.seed
    refused = 0
    while time.monotonic() < end or seed == arguments.seed:
        try:
            refused += run_batch(seed)
        except Exception:
            print(f"failed with --seed {seed}", file=sys.stderr)
            raise
        seed += 1
    batches = seed - arguments.seed
    print(f"{batches * BATCH} datagrams, {refused} refused, nothing raised, limits held")
    return 0


if __name__ == "__main__":
    sys.exit(main())
