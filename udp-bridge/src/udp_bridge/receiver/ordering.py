# SPDX-License-Identifier: Apache-2.0
"""Order of one topic's messages by seq_number modulo 2**32, and the messages that are finished.

Input is (seq_number, stamp) pairs and times, never bodies. Stamps break ties: a lower number with
a newer stamp comes from a restarted sender. A number that jumps is believed when the next one
follows it (RFC 3550, A.1), so a single forged datagram cannot silence a topic.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Set, Tuple, Union

from udp_bridge.wire.header import NANOS, SEQ_NUMBERS, Header
from udp_bridge.wire.message import Message
from udp_bridge.wire.types import STAMP_ORDERED

RESTART_SEQ_NUMBERS = 256
"""Only a number lower than this can show a restart by itself..."""
RESTART_SILENCE_NANOS = NANOS
"""...and only if nothing was delivered for this long, far longer than networks reorder."""
MAX_AHEAD = 3000
MAX_BEHIND = 100
"""A number this far ahead, or farther behind than this, is a jump: MAX_DROPOUT and MAX_MISORDER
of RFC 3550, A.1."""
STALE_NANOS = 2 * NANOS
"""In topics ordered by stamp, a message is stale if it is older than the newest one by up to this.
If it is older by more, the sender's clock was set back: nothing delays a message for longer."""
FINISHED_REMEMBERED = 64
"""Finished messages of a topic whose duplicates are still recognized."""

MessageKey = Tuple[int, int]
"""seq_number and stamp in nanoseconds: identifies a message within its topic."""


def key_of(message: Union[Header, Message]) -> MessageKey:
    """Return the key of a message."""
    return message.seq_number, message.stamp_nanos


def ahead_by(seq_number: int, other: int) -> int:
    """Return how far a number is ahead of another one; negative if it is behind."""
    difference = (seq_number - other) % SEQ_NUMBERS
    return difference if difference < SEQ_NUMBERS // 2 else difference - SEQ_NUMBERS


class TopicOrder:
    """Delivered and finished messages of one topic of one sender."""

    __slots__ = (
        "_finished",
        "_is_last",
        "_last_delivery_nanos",
        "_last_seq",
        "_last_stamp",
        "_recent",
        "_suspect",
    )

    def __init__(self) -> None:
        self._last_seq: Optional[int] = None
        self._last_stamp = 0
        self._last_delivery_nanos = 0
        self._suspect: Optional[int] = None  # number of the last jump or stale message
        self._finished: Set[MessageKey] = set()
        self._recent: Deque[MessageKey] = deque()
        self._is_last: Optional[bool] = None  # see `is_last`; None: to be found out

    def ahead_by(self, seq_number: int) -> int:
        """Return how far a number is ahead of the last delivered one; 1 if there is none."""
        return 1 if self._last_seq is None else ahead_by(seq_number, self._last_seq)

    def is_restart_after_silence(self, header: Header, now_nanos: int) -> bool:
        """Tell whether a datagram shows a restarted sender by its low number after a silence."""
        return (
            self._last_seq is not None
            and header.seq_number < RESTART_SEQ_NUMBERS
            and now_nanos - self._last_delivery_nanos >= RESTART_SILENCE_NANOS
            and self.ahead_by(header.seq_number) <= 0
        )

    def newer_by(self, header: Header) -> int:
        """Return the nanoseconds by which a stamp is newer than the last delivered one."""
        return header.stamp_nanos - self._last_stamp

    def is_jump(self, header: Header, max_behind: int = MAX_BEHIND) -> bool:
        """Tell whether a number is too far from the last delivered one to be believed alone."""
        if self._last_seq is None:
            return False
        ahead = self.ahead_by(header.seq_number)
        return ahead >= MAX_AHEAD or (ahead < -max_behind and self.newer_by(header) <= 0)

    def is_stale(self, header: Header) -> bool:
        """Tell whether a message is older than the newest one, in a topic ordered by stamp."""
        return (
            self._last_seq is not None
            and header.msg_type in STAMP_ORDERED
            and -STALE_NANOS <= self.newer_by(header) < 0
        )

    def follows_suspect(self, seq_number: int, max_ahead: int = 1) -> bool:
        """Tell whether a number follows the suspect one, with no delivery in between."""
        if self._suspect is None:
            return False
        return 0 < (seq_number - self._suspect) % SEQ_NUMBERS <= max_ahead

    def mark_suspect(self, seq_number: int) -> bool:
        """Remember a number that is not believed; return whether it differs from the last one."""
        is_new = seq_number != self._suspect
        self._suspect = seq_number
        return is_new

    def is_finished(self, header: Header) -> bool:
        """Tell whether the message was delivered, late or given up, and is still remembered."""
        return key_of(header) in self._finished

    def mark_delivered(self, header: Header, now_nanos: int) -> int:
        """Remember the last delivered message; return how many numbers it skipped."""
        skipped = max(0, self.ahead_by(header.seq_number) - 1)
        self._is_last = None
        self._last_seq = header.seq_number
        self._last_stamp = header.stamp_nanos
        self._last_delivery_nanos = now_nanos
        self._suspect = None
        return skipped

    def end_silence(self, now_nanos: int) -> None:
        """Remember that a message behind the last one was delivered.

        Otherwise a copy of it, after a silence, would show a restart and be delivered again.
        """
        self._last_delivery_nanos = now_nanos

    def is_next(self, msg_type: int, key: MessageKey) -> bool:
        """Tell whether a message is the next one and may be delivered.

        The next number means no restart, no gap and no late message.
        """
        number, stamp_nanos = key
        return (
            self._last_seq is not None
            and number == (self._last_seq + 1) % SEQ_NUMBERS
            and key not in self._finished
            and (stamp_nanos >= self._last_stamp or msg_type not in STAMP_ORDERED)
        )

    def deliver_next(self, header: Header, now_nanos: int) -> bool:
        """Fast path: deliver and finish a message if it is the next one; return whether it is."""
        msg_type, seq_number, _, _, sec, nsec, _, _ = header
        key = (seq_number, sec * NANOS + nsec)
        if not self.is_next(msg_type, key):
            return False
        self.record_next(key, now_nanos)
        return True

    def record_next(self, key: MessageKey, now_nanos: int) -> None:
        """Record a delivered message that is the next one."""
        self._remember(key)
        self._last_seq, self._last_stamp = key
        self._suspect = None
        self._last_delivery_nanos = now_nanos

    @property
    def is_last(self) -> bool:
        """Whether no message later than the last delivered one is finished."""
        last = self._last_seq
        if self._is_last is None and last is not None:
            self._is_last = not any(ahead_by(number, last) > 0 for number, _ in self._finished)
        return bool(self._is_last)

    def is_at_end(self, header: Header) -> bool:
        """Tell whether a message is the last delivered one, and no later one is finished."""
        return header.seq_number == self._last_seq and self.is_last

    @property
    def last(self) -> Optional[MessageKey]:
        """The last delivered message, if `is_next` holds for any next one in order."""
        number = self._last_seq
        return (number, self._last_stamp) if number is not None and self.is_last else None

    def mark_finished(self, header: Header) -> None:
        """Remember that this message needs no more parts."""
        key = key_of(header)
        if key not in self._finished:
            self._remember(key)
            self._is_last = None

    def _remember(self, key: MessageKey) -> None:
        self._finished.add(key)
        self._recent.append(key)
        if len(self._recent) > FINISHED_REMEMBERED:
            self._finished.discard(self._recent.popleft())

    def reset(self) -> None:
        """Start over, as for an unknown sender."""
        self._last_seq = self._suspect = self._is_last = None
        self._finished.clear()
        self._recent.clear()
