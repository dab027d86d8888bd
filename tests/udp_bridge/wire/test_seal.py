# SPDX-License-Identifier: Apache-2.0
"""What is sealed opens once, at the other end, unchanged; everything else is refused by reason."""

import hashlib
import random

import pytest

from udp_bridge.wire.header import NANOS, Refused, parse
from udp_bridge.wire.seal import FROM_ROS, OVERHEAD, SENDERS, STALE_NANOS, TO_ROS, WINDOW, Seal

SECRET = bytes(range(16))
NOW = 1_700_000_000 * NANOS
PLAIN = b"header and part"


def sender(number: int = 7, *, secret: bytes = SECRET) -> Seal:
    return Seal(secret, sends=TO_ROS, sender=number)


@pytest.fixture
def receiver() -> Seal:
    return Seal(SECRET, sends=FROM_ROS, sender=8)


def sealed(seal: Seal, plain: bytes = PLAIN, now: int = NOW) -> bytes:
    return b"".join(seal.sealed([plain[:6], memoryview(plain)[6:]], seal.next_counter(now)))


def opened(receiver: Seal, datagram: bytes, now: int = NOW) -> bytes | str:
    """Return the plain datagram, or why there is none."""
    try:
        return bytes(receiver.opened(memoryview(datagram), now))
    except Refused as refused:
        return refused.reason


def test_sealed_datagram_opens(receiver: Seal) -> None:
    datagram = sealed(sender())
    assert len(datagram) == len(PLAIN) + OVERHEAD
    assert opened(receiver, datagram) == PLAIN
    assert opened(receiver, sealed(sender(), b"")) == "replayed"  # of the same number and instant
    assert opened(receiver, sealed(sender(9), b"")) == b""


def test_the_bytes_are_those_of_the_page() -> None:
    head = bytes.fromhex("44 14 07000000 00 01 00000000 00000000 0000 0000")
    counted = head + NOW.to_bytes(8, "little") + PLAIN
    key = hashlib.blake2b(SECRET, digest_size=32, person=b"udp-bridge key").digest()
    tag = hashlib.blake2b(counted, key=key, digest_size=16).digest()
    assert sealed(sender()) == counted + tag


def test_the_payload_is_not_copied() -> None:
    body = memoryview(bytearray(1000))
    buffers = sender().sealed([b"h", body], NOW)
    assert buffers[2] is body


def test_every_flipped_bit_is_refused(receiver: Seal) -> None:
    datagram = sealed(sender())
    for bit in range(8 * len(datagram)):
        wrong = bytearray(datagram)
        wrong[bit // 8] ^= 1 << bit % 8
        expected = "unsealed" if bit < 8 else "bad_tag"
        assert opened(receiver, bytes(wrong)) == expected, bit
    assert opened(receiver, datagram) == PLAIN  # none of these has spent its counter


def test_every_other_length_is_refused(receiver: Seal) -> None:
    datagram = sealed(sender())
    assert opened(receiver, b"") == "unsealed"
    for size in range(1, len(datagram)):
        assert opened(receiver, datagram[:size]) == "bad_tag"
    assert opened(receiver, datagram + b"\0") == "bad_tag"


def test_other_keys_and_none_are_refused(receiver: Seal) -> None:
    assert opened(receiver, sealed(sender(secret=bytes(16)))) == "bad_tag"
    assert opened(receiver, PLAIN) == "unsealed"
    with pytest.raises(Refused, match=r"^sealed$"):
        parse(sealed(sender()))


def test_a_datagram_opens_once(receiver: Seal) -> None:
    seal = sender()
    datagrams = [sealed(seal, bytes([n])) for n in range(100)]
    order = [*datagrams, *datagrams]
    random.Random(1).shuffle(order)
    order.insert(0, datagrams[0])  # what is older than the first one seen is refused, too
    results = [opened(receiver, datagram) for datagram in order]
    assert sorted(r for r in results if isinstance(r, bytes)) == [bytes([n]) for n in range(100)]
    assert results.count("replayed") == 101


def test_counters_before_the_first_are_refused(receiver: Seal) -> None:
    seal = sender()
    before, first = sealed(seal), sealed(seal)
    assert opened(receiver, first) == PLAIN
    assert opened(receiver, before) == "replayed"


def test_replay_window_has_its_declared_width(receiver: Seal) -> None:
    seal = sender()
    assert opened(receiver, sealed(seal)) == PLAIN
    early = [sealed(seal), sealed(seal)]
    for _ in range(WINDOW - 1):
        assert opened(receiver, sealed(seal)) == PLAIN
    assert opened(receiver, early[1]) == PLAIN
    assert opened(receiver, early[0]) == "replayed"


def test_own_datagrams_do_not_open(receiver: Seal) -> None:
    assert opened(receiver, sealed(receiver)) == "reflected"
    before_restart = Seal(SECRET, sends=FROM_ROS, sender=9)
    assert opened(receiver, sealed(before_restart)) == "reflected"


def test_both_ends_may_restart(receiver: Seal) -> None:
    first = sender(1)
    old = [sealed(first) for _ in range(3)]
    assert all(opened(receiver, datagram) == PLAIN for datagram in old)
    second = sender(2)
    assert opened(receiver, sealed(second, now=NOW + NANOS)) == PLAIN
    assert {opened(receiver, datagram) for datagram in old} == {"replayed"}
    # The receiver forgets what it saw; the clock refuses what is old.
    again = Seal(SECRET, sends=FROM_ROS, sender=3)
    later = NOW + STALE_NANOS + NANOS
    assert {opened(again, datagram, later) for datagram in old} == {"stale"}
    assert opened(again, sealed(second, now=later), later) == PLAIN


def test_a_clock_that_is_set_back_while_the_process_runs_does_no_harm(receiver: Seal) -> None:
    seal = sender()
    for now in (NOW, NOW - 3600 * NANOS, NOW - 3600 * NANOS, NOW + 1):
        assert opened(receiver, sealed(seal, now=now)) == PLAIN
    assert opened(receiver, sealed(seal), NOW + 3600 * NANOS) == PLAIN  # ours is set forward


def test_memory_is_bounded(receiver: Seal) -> None:
    for number in range(3 * SENDERS):
        seal = sender(number)
        for _ in range(3):
            assert opened(receiver, sealed(seal)) == PLAIN
    assert len(receiver._windows) == SENDERS
    for _ in range(3 * WINDOW):
        assert opened(receiver, sealed(seal)) == PLAIN
    window = receiver._windows[3 * SENDERS - 1]
    assert len(window._seen) == len(window._by_age) == WINDOW


def test_refused_datagrams_leave_nothing(receiver: Seal) -> None:
    rng = random.Random(2)
    for _ in range(2000):
        assert opened(receiver, b"\x44" + rng.randbytes(rng.randrange(100))) == "bad_tag"
    assert not receiver._windows
