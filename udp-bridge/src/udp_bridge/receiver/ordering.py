# SPDX-License-Identifier: Apache-2.0
"""The order of one topic's messages, judged by seq_number modulo 2**32, and what was finished.

Only (seq_number, stamp) pairs and times come in; no bodies. Stamps break ties: a message that is
behind in number but newer in stamp comes from a sender that was restarted. A number that jumps is
believed when the next one follows it (RFC 3550, A.1), so that a single forged datagram does not
silence a topic.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Set, Tuple

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header
from udp_bridge.wire.types import STAMP_ORDERED

RESTART_SEQ_NUMBERS = 256
"""A sender is taken as restarted by its number alone only while its numbers are this low..."""
RESTART_SILENCE_NANOS = NANOS
"""...and only after nothing was handed over for this long, far longer than networks reorder."""
MOST_AHEAD = 3000
MOST_BEHIND = 100
"""Numbers this far ahead, or farther behind than this, jump: MAX_DROPOUT and MAX_MISORDER of
RFC 3550, A.1."""
STALE_NANOS = 2 * NANOS
"""In topics ordered by stamp, a message is stale when older than the newest one by up to this much.
By more, the sender's clock was set back: networks and reassembly hold nothing for longer."""
FINISHED_REMEMBERED = 64
"""Finished messages of a topic whose copies are still known for what they are."""

Key = Tuple[int, int, int]


def key_of(header: Header) -> Key:
    """Return what tells a message from the others of its sender, type and topic."""
    return header.seq_number, header.time_sec, header.time_nsec


class Order:
    """What has been handed over of one topic of one sender."""

    __slots__ = (
        "_finished",
        "_last_handed_nanos",
        "_last_seq",
        "_last_stamp",
        "_recent",
        "_suspect",
    )

    def __init__(self) -> None:
        self._last_seq: Optional[int] = None
        self._last_stamp = 0
        self._last_handed_nanos = 0
        self._suspect: Optional[int] = None  # the last number that jumped, or was of a stale one
        self._finished: Set[Key] = set()
        self._recent: Deque[Key] = deque()

    def ahead_by(self, seq_number: int) -> int:
        """Return how far a number is ahead of the last one handed over; 0 or less is behind."""
        if self._last_seq is None:
            return 1
        difference = (seq_number - self._last_seq) % SEQ_NUMBERS
        return difference if difference < SEQ_NUMBERS // 2 else difference - SEQ_NUMBERS

    def is_restart_by_silence(self, header: Header, now_nanos: int) -> bool:
        """Tell whether a datagram, before anything else is asked, shows a restarted sender."""
        return (
            self._last_seq is not None
            and header.seq_number < RESTART_SEQ_NUMBERS
            and now_nanos - self._last_handed_nanos >= RESTART_SILENCE_NANOS
            and self.ahead_by(header.seq_number) <= 0
        )

    def is_newer(self, header: Header) -> bool:
        """Tell whether a header's stamp is newer than that of the last message handed over."""
        return header.stamp_nanos > self._last_stamp

    def newer_by(self, header: Header) -> int:
        """Return how much newer a header's stamp is than that of the last one handed over."""
        return header.stamp_nanos - self._last_stamp

    def is_jump(self, header: Header, most_behind: int = MOST_BEHIND) -> bool:
        """Tell whether a number is too far from the last one handed over to be believed alone."""
        if self._last_seq is None:
            return False
        ahead = self.ahead_by(header.seq_number)
        return ahead >= MOST_AHEAD or (ahead < -most_behind and not self.is_newer(header))

    def is_stale(self, header: Header) -> bool:
        """Tell whether a message is older than the newest one, in a topic ordered by stamp."""
        return (
            self._last_seq is not None
            and header.msg_type in STAMP_ORDERED
            and -STALE_NANOS <= self.newer_by(header) < 0
        )

    def is_second(self, seq_number: int, most_ahead: int = 1) -> bool:
        """Tell whether a number follows the suspect one, with nothing handed over in between."""
        if self._suspect is None:
            return False
        return 0 < (seq_number - self._suspect) % SEQ_NUMBERS <= most_ahead

    def suspect(self, seq_number: int) -> bool:
        """Remember a number that is not believed; return whether it is another than before."""
        is_new = seq_number != self._suspect
        self._suspect = seq_number
        return is_new

    def is_finished(self, header: Header) -> bool:
        """Tell whether the message was handed over, late or given up, and is remembered."""
        return key_of(header) in self._finished

    def hand_over(self, header: Header, now_nanos: int) -> int:
        """Remember a message as the last one handed over; return the gap before it."""
        missing = max(0, self.ahead_by(header.seq_number) - 1)
        self._last_seq = header.seq_number
        self._last_stamp = header.stamp_nanos
        self._last_handed_nanos = now_nanos
        self._suspect = None
        return missing

    def takes_next(self, header: Header, now_nanos: int) -> bool:
        """Hand over and finish a message in one, if it is the next by its number, as most are.

        Behind the last one handed over comes no restart, no gap and nothing late.
        """
        msg_type, seq_number, _, _, sec, nsec, _, _ = header
        key = (seq_number, sec, nsec)
        if self._last_seq is None or seq_number != (self._last_seq + 1) % SEQ_NUMBERS:
            return False
        stamp = sec * NANOS + nsec
        if key in self._finished or (stamp < self._last_stamp and msg_type in STAMP_ORDERED):
            return False
        self._remember(key)
        self._last_seq = seq_number
        self._last_stamp = stamp
        self._suspect = None
        self._last_handed_nanos = now_nanos
        return True

    def finish(self, header: Header) -> None:
        """Remember that this message needs no more parts."""
        key = key_of(header)
        if key not in self._finished:
            self._remember(key)

    def _remember(self, key: Key) -> None:
        self._finished.add(key)
        self._recent.append(key)
        if len(self._recent) > FINISHED_REMEMBERED:
            self._finished.discard(self._recent.popleft())

    def forget(self) -> None:
        """Begin anew, as for a sender never heard of."""
        self._last_seq = self._suspect = None
        self._finished.clear()
        self._recent.clear()
