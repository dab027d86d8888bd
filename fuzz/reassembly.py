# SPDX-License-Identifier: Apache-2.0
"""Whatever datagrams arrive, a refused one changes nothing, nothing is raised, limits hold.

`python -m fuzz.reassembly [--datagrams N] [--seconds S] [--seed N]` mixes random bytes, honest
messages and mutations of these and of the vectors, from several senders, and prints how many
there were and what memory the process took at most. A failure prints the seed that repeats it.
"""

from __future__ import annotations

import argparse
import gc
import random
import resource
import sys
import time
from pathlib import Path

from udp_bridge import MSG_TYPES, Header, Message, fragments
from udp_bridge.sender.repair import parse_mode
from udp_bridge.sender.send_queue import Outbox
from udp_bridge.wire.capture import datagrams
from udp_bridge.wire.fec import is_available
from udp_bridge.wire.fragments import DatagramSize

from .twins import SENDERS, Twins

BATCH = 20_000
PEERS = (2, SENDERS)
"""In a batch: as few as honest ones are, and more than there may be."""
SIZES: list[DatagramSize] = [256, "mtu"]
MODES: list[object] = ["none", "resend", *([{"fec": 0.3}] if is_available() else [])]
PAUSES_NANOS = (0, 0, 0, 1000, 1000, 10**6)
VECTORS = Path(__file__).parents[1] / "tests" / "vectors"
LONGEST = 3000
"""Of random datagrams, in bytes."""


def message(rng: random.Random) -> list[bytes]:
    """Return the datagrams of a message as any sender might send it."""
    header = Header(
        msg_type=rng.choice(list(MSG_TYPES)),
        seq_number=rng.choice([0, 1, 2, 255, 256, 2**31, 2**32 - 1, rng.getrandbits(32)]),
        part_number=0,
        parts_max=1,
        time_sec=rng.choice([0, 1, -(2**31), 2**31 - 1]),
        time_nsec=rng.randrange(10**9),
        topic=rng.choice(["", "/a", "/ż", "/" + "x" * rng.randrange(100)]),
        link=rng.choice(["", "l", "y" * rng.randrange(100)]),
    )
    body = rng.randbytes(rng.choice([0, 1, 8, 12, 40, 72, 300, 3000]))
    whole = Message(
        header.msg_type, header.topic, header.link, header.stamp_nanos, header.seq_number, body
    )
    return [head + bytes(part) for head, part in fragments(whole, rng.choice(SIZES))]


def repaired(rng: random.Random) -> list[bytes]:
    """Return the datagrams of messages with their repair data, or of some that may be resent."""
    mode = parse_mode(rng.choice(MODES))
    outbox = Outbox(("", 0), rng.choice(SIZES), repair={} if mode is None else {(1, "/a"): mode})
    cut: list[bytes] = []
    for index in range(2):
        body = rng.randbytes(rng.choice([1, 300, 3000]))
        outbox.put(Message(1, "/a", "l", index * 10**9, 0, body))
        while (datagram := outbox.take(index)) is not None:
            cut.append(datagram.header + bytes(datagram.part))
    return cut


def recorded() -> list[bytes]:
    """Return the datagrams of all vectors."""
    found = []
    for path in sorted(VECTORS.glob("*.bin")):
        with open(path, "rb") as file:
            found += list(datagrams(file))
    return found


def mutated(rng: random.Random, datagram: bytes) -> bytes:
    """Return a datagram with up to three bytes changed, most of them in the header, or cut."""
    changed = bytearray(datagram)
    fate = rng.getrandbits(16)
    for _ in range(1 + fate % 3 if changed else 0):
        reach = 18 if fate & 64 else 300
        changed[int(rng.random() * min(len(changed), reach))] = rng.getrandbits(8)
    if not fate & 7 << 8:
        del changed[int(rng.random() * (len(changed) + 1)) :]
    return bytes(changed)


def run_batch(seed: int, vectors: list[bytes]) -> Twins:
    """Feed one batch to fresh receivers and return them."""
    rng = random.Random(seed)
    twins = Twins()
    senders = rng.choice(PEERS)
    while twins.datagrams < BATCH:
        pool = [datagram for _ in range(20) for datagram in message(rng)]
        pool += [datagram for _ in range(5) for datagram in repaired(rng)]
        pool += rng.choices(vectors, k=100)
        for _ in range(4 * len(pool)):
            kind = rng.random()
            if kind < 0.05:
                datagram = rng.randbytes(int(LONGEST * rng.random() ** 4))
            else:
                datagram = pool[int(rng.random() * len(pool))]
                if kind < 0.75:
                    datagram = mutated(rng, datagram)
            sender = int(rng.random() * senders)
            twins.feed(datagram, sender, PAUSES_NANOS[rng.getrandbits(8) % len(PAUSES_NANOS)])
        twins.compare()
    twins.end()
    return twins


def peak_mb() -> float:
    """Return the most memory that this process ever took, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e6


def main() -> int:
    """Run batches until there were enough datagrams or the time is over."""
    parser = argparse.ArgumentParser(prog="python -m fuzz.reassembly")
    parser.add_argument("--datagrams", type=int, default=10_000_000)
    parser.add_argument("--seconds", type=float, default=3600.0, help="at most")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    vectors = recorded()
    started = time.monotonic()
    seed = arguments.seed
    fed = refused = whole = 0
    first_mb = 0.0
    while fed < arguments.datagrams and time.monotonic() - started < arguments.seconds:
        try:
            twins = run_batch(seed, vectors)
        except Exception:
            print(f"failed with --seed {seed}", file=sys.stderr)
            raise
        fed, refused = fed + twins.datagrams, refused + twins.refused
        whole += twins.messages
        del twins
        gc.collect()  # receivers hold cycles, and no real one is made anew again and again
        first_mb = first_mb or peak_mb()
        seed += 1
    took_s = time.monotonic() - started
    print(
        f"{fed} datagrams in {took_s:.0f} s: {refused} refused, {whole} messages; nothing raised,"
        f" nothing changed by a refused one, limits held; peak memory {peak_mb():.1f} MB,"
        f" {first_mb:.1f} MB after the first {BATCH}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
