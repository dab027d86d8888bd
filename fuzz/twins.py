# SPDX-License-Identifier: Apache-2.0
"""Two receivers, of which one is spared what the other one refuses: they must stay alike.

So "a refused datagram changes nothing" is checked by all that comes behind it, without looking
into either of them. The memory limit is checked after every datagram.
"""

from __future__ import annotations

from typing import Any

from udp_bridge import Limits, Message, Reassembler, Refused, fragments, parse

LIMITS = Limits(memory_bytes=1 << 20, senders=8, topics=32)
"""Small enough that every limit is met all the time."""
SENDERS = 12
"""How many there are at most: more than are remembered."""
HONEST = Message(1, "/honest", "", 0, 0, bytes(5000))


class Twins:
    """A receiver that is fed everything, and one that is fed what the first one took."""

    def __init__(self) -> None:
        self.datagrams = 0
        self.refused = 0
        self.messages = 0
        self._seer = Reassembler(LIMITS)
        self._spared = Reassembler(LIMITS)
        self._now_nanos = 0

    def feed(self, datagram: bytes, sender: int, pause_nanos: int) -> None:
        """Let a datagram arrive; `AssertionError` when it breaks a rule."""
        self._now_nanos += pause_nanos
        self.datagrams += 1
        try:
            header, offset = parse(datagram)
            part = memoryview(datagram)[offset:]
            message = self._seer.accept(header, part, sender, self._now_nanos)
        except Refused:
            self.refused += 1
            assert 0 <= self._seer.memory_bytes <= LIMITS.memory_bytes
            return
        assert 0 <= self._seer.memory_bytes <= LIMITS.memory_bytes
        self.messages += message is not None
        assert self._spared.accept(header, part, sender, self._now_nanos) == message

    def compare(self) -> None:
        """Check that both hold and have counted the same."""
        for reassembler in (self._seer, self._spared):
            reassembler.expire(self._now_nanos)
        seen, spared = (self._state(each) for each in (self._seer, self._spared))
        assert seen == spared, f"{seen} is not {spared}"

    def end(self) -> None:
        """Compare; then an honest message must still pass, and at the end nothing be held."""
        self.compare()
        cut = [header + bytes(part) for header, part in fragments(HONEST)]
        results = [self._seer.receive(datagram, "honest", self._now_nanos) for datagram in cut]
        assert [result is not None for result in results] == [True]
        self._seer.give_up_all()
        assert self._seer.memory_bytes == 0

    def _state(self, reassembler: Reassembler) -> dict[str, Any]:
        counts = reassembler.counters.as_dict()
        del counts["refused"]
        return {
            "totals": counts,
            "memory_bytes": reassembler.memory_bytes,
            "reports": [reassembler.reports(sender, self._now_nanos) for sender in range(SENDERS)],
        }
