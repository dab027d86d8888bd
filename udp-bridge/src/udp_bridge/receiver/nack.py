# SPDX-License-Identifier: Apache-2.0
"""Negative acknowledgements: which lost parts and messages of a topic to request, and when.

A topic has a tracker only while its sender offers to resend, and a message is requested only
while it is not older than the offer's limit. The tracker never waits: datagrams of the topic,
offers included, are the occasions to request what is due. `round_trip` computes the delays.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Dict, Iterator, List, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import SEQ_NUMBERS, Header
from udp_bridge.wire.repair import WHOLE_MAX, Offer, Request, parts_of

from .ordering import MAX_AHEAD, MessageKey, ahead_by
from .round_trip import RoundTrip

MAX_COPIES = 3
"""The first repetition of a request is sent twice, later ones this many times: requests are small,
and a burst of losses would take one after the other. The sender treats copies as one request."""
MAX_TRIES = 16
MAX_ENTRIES = 64
"""Incomplete messages of a topic that are tracked; the oldest is dropped."""

_WHOLE = -1
"""Part number that stands for all parts of a message of which nothing arrived."""

Due = Tuple[int, int]
"""When to request a part, and how often it was requested. Equal for parts requested together."""


class NackKey(NamedTuple):
    """Identity of an incomplete message: two messages of a sender may share a seq_number."""

    seq_number: int
    time_sec: int = 0
    time_nsec: int = 0
    parts_max: int = 0
    """0, with time 0, while no part of the message has arrived: only its number is known."""


class Nack(NamedTuple):
    """A request, the header fields that go with it, and how often to send it."""

    seq_number: int
    time: Tuple[int, int]
    request: Request
    copies: int = 1


class NackEntry:
    """An incomplete message: its missing parts and their requests."""

    __slots__ = (
        "answered",
        "due",
        "highest",
        "is_requested",
        "requested_nanos",
        "since_nanos",
    )

    def __init__(self, since_nanos: int) -> None:
        self.since_nanos = since_nanos
        """When its first part, or the gap, was noticed."""
        self.due: Dict[int, Due] = {}
        """Missing parts by number."""
        self.highest = -1
        """All parts up to this one have been sent."""
        self.requested_nanos = 0
        self.is_requested = False
        self.answered: Optional[Due] = None
        """`due` of the requested part that arrived last."""

    def advance_lost_again(self, part: int, due_nanos: int) -> bool:
        """Bring forward the parts before `part` that were requested together with it.

        They were resent before it, so they were lost again unless it overtook them (RFC 8985).
        Returns whether there are any.
        """
        answered = self.due.get(part)
        if answered is None or not answered[1]:
            return False
        self.answered = answered
        lost = [other for other, due in self.due.items() if due == answered and other < part]
        if due_nanos < answered[0]:
            self.due.update(dict.fromkeys(lost, (due_nanos, answered[1])))
        return bool(lost)

    def advance_offered(self, now_nanos: int, round_trip_nanos: int) -> None:
        """Bring forward the parts that an Offer shows to be lost.

        The sender sent it behind everything requested until then. A request arrived before that
        if some of it was answered, or if a round trip has passed (0: not measured yet).
        """
        is_over = bool(round_trip_nanos) and now_nanos - self.requested_nanos >= round_trip_nanos
        for part, due in self.due.items():
            tries = due[1]
            if not tries or due == self.answered or (tries == 1 and is_over):
                self.due[part] = (now_nanos, tries)


class NackTracker:
    """Incomplete messages of one topic of one sender."""

    def __init__(self) -> None:
        self._limit_nanos = 0
        self._newest: Optional[int] = None
        self._newest_stamp_nanos = 0
        self._was_reset = False
        self._entries: OrderedDict[NackKey, NackEntry] = OrderedDict()  # oldest first
        self._due_nanos: Optional[int] = None  # no part is due before
        self._round_trip = RoundTrip()

    def is_missing(self, header: Header, now_nanos: int) -> bool:
        """Tell whether a message is tracked as incomplete and still within the limit."""
        entry = self._find(header, header.parts_max)
        return entry is not None and now_nanos - entry.since_nanos <= self._limit_nanos

    def is_restart(self, header: Header) -> bool:
        """Tell whether a message that is neither tracked nor finished shows a restarted sender.

        Without a restart, a newer stamp has a higher number.
        """
        newest = self._newest
        is_ahead = newest is None or ahead_by(header.seq_number, newest) > 0
        return not is_ahead and header.stamp_nanos > self._newest_stamp_nanos

    def is_jump(self, seq_number: int, max_behind: int) -> bool:
        """Tell whether a number is too far from the newest one to be believed alone."""
        if self._newest is None:
            return False
        return not -max_behind <= ahead_by(seq_number, self._newest) < MAX_AHEAD

    def is_within_limit(self, nanos: int) -> bool:
        """Tell whether a message of this age may still be resent."""
        return nanos <= self._limit_nanos

    def is_requested(self, header: Header) -> bool:
        """Tell whether any part of a message was requested."""
        entry = self._find(header, header.parts_max)
        return entry is not None and entry.is_requested

    def is_settled(self, seq_number: int) -> bool:
        """Tell whether this number is the newest one and nothing is missing."""
        return self._newest == seq_number and not self._entries and self._due_nanos is None

    def on_whole(self, key: MessageKey) -> None:
        """Take a whole message that was the next one while all before it was settled."""
        self._newest, self._newest_stamp_nanos = key

    @property
    def due_nanos(self) -> int:
        """When something is due to be requested; 0 when nothing is."""
        return self._due_nanos or 0

    @property
    def debounce_nanos(self) -> int:
        """Delay from the detection of a gap to its request."""
        return self._round_trip.debounce_nanos

    def on_offer(self, header: Header, offer: Offer, *, is_finished: bool, now_nanos: int) -> None:
        """Take an Offer: the sender sent all parts of the message in the header.

        Parameters
        ----------
        is_finished
            Whether nothing of that message is missing.
        """
        self._limit_nanos = offer.limit_ms * 1_000_000
        newest = self._newest
        is_known = newest is not None and ahead_by(header.seq_number, newest) <= 0
        self._advance(header, now_nanos)
        entry = self._find(header, offer.parts_max)
        if entry is None and not is_known and not is_finished:
            entry = self._add(NackKey(header.seq_number), now_nanos)
            entry.due[_WHOLE] = (now_nanos, 0)
        if entry is None:
            return
        if _WHOLE not in entry.due:
            self._mark_sent(entry, offer.parts_max, now_nanos)
        entry.advance_offered(now_nanos, self._round_trip.upper_nanos)
        self._due_nanos = now_nanos

    def on_parts(
        self, header: Header, *, is_complete: bool, now_nanos: int, count: int = 1
    ) -> None:
        """Take `count` consecutive parts that arrived, the first one with this header.

        Parameters
        ----------
        is_complete
            Whether their message is complete now.
        """
        seq_number, first = header.seq_number, header.part_number
        self._advance(header, now_nanos)
        entry = self._identified(header)
        if is_complete:
            if entry is not None:
                self._measure(entry, first, now_nanos)
                self.discard(header)
            if not self._entries:
                self._due_nanos = None
            return
        if entry is None:
            entry = self._add(_key_of(header, header.parts_max), now_nanos)
        whole = entry.due.pop(_WHOLE, None)
        if whole is not None or seq_number != self._newest:
            # It was sent completely; a message that was requested as a whole is on its way.
            wait = (
                self._round_trip.wait_nanos(whole[1])
                if whole and whole[1]
                else self._round_trip.debounce_nanos
            )
            tries = whole[1] if whole else 0
            self._mark_sent(entry, header.parts_max, now_nanos + wait, tries)
        self._measure(entry, first, now_nanos)
        due_nanos = now_nanos + self._round_trip.debounce_nanos
        if entry.due:
            if entry.advance_lost_again(first, due_nanos):
                self._wake_at(due_nanos)
            for part in range(first, first + count):
                entry.due.pop(part, None)
        if entry.is_requested:  # one request per round trip covers all gaps found meanwhile
            due_nanos = max(due_nanos, entry.requested_nanos + self._round_trip.nanos)
        self._mark_sent(entry, first, due_nanos)
        entry.highest = max(entry.highest, first + count - 1)

    def on_requested(
        self, header: Header, bitmap: bytes, requested_nanos: int, now_nanos: int
    ) -> None:
        """Take a request that the socket sent, the first one for this message.

        The parts that arrived with it are reported by `on_parts`.
        """
        self._advance(header, now_nanos)
        key = _key_of(header, header.parts_max)
        entry = self._identified(header) or self._add(key, now_nanos)
        entry.is_requested, entry.requested_nanos = True, requested_nanos
        due = (requested_nanos + self._round_trip.wait_nanos(0), 1)
        parts = parts_of(bitmap)
        entry.due.update(dict.fromkeys(parts, due))
        entry.highest = max(entry.highest, *parts)
        self._wake_at(due[0])

    def discard(self, header: Header) -> None:
        """Stop tracking a message that is complete or was given up."""
        self._entries.pop(_key_of(header, header.parts_max), None)

    def reset(self) -> None:
        """Start over after a restart of the sender."""
        self._newest = None
        self._was_reset = True
        self._entries.clear()
        self._due_nanos = None

    def take_due(self, msg_type: int, now_nanos: int) -> List[Nack]:
        """Return the requests that are due now; the caller fills in the goodput."""
        if self._due_nanos is None or now_nanos < self._due_nanos:
            return []
        for key, entry in list(self._entries.items()):
            if now_nanos - entry.since_nanos > self._limit_nanos:
                del self._entries[key]
        nacks: List[Nack] = []
        for (seq_number, sec, nsec, parts_max), entry in self._entries.items():
            taken = dict(self._take_due_parts(entry, now_nanos))
            if not taken:
                continue
            parts = tuple(sorted(taken))
            copies = min(1 + (max(taken.values()) + 1) // 2, MAX_COPIES)
            if parts != (_WHOLE,):
                request = Request(msg_type, parts_max, 1, 0, parts)
                nacks.append(Nack(seq_number, (sec, nsec), request, copies))
            elif nacks and _is_next_whole(nacks[-1], seq_number):
                last = nacks[-1]
                request = last.request._replace(messages=last.request.messages + 1)
                nacks[-1] = last._replace(request=request)
            else:
                nacks.append(Nack(seq_number, (0, 0), Request(msg_type, 0, 1, 0), copies))
        dues = [due for entry in self._entries.values() for due, _ in entry.due.values()]
        self._due_nanos = min(dues) if dues else None
        return nacks

    def _take_due_parts(self, entry: NackEntry, now_nanos: int) -> Iterator[Tuple[int, int]]:
        """Yield each due part with its number of earlier requests; schedule its repetition."""
        for part, (due_nanos, tries) in list(entry.due.items()):
            if due_nanos > now_nanos:
                continue
            if tries >= MAX_TRIES:
                del entry.due[part]
                continue
            entry.due[part] = (now_nanos + self._round_trip.wait_nanos(tries), tries + 1)
            entry.requested_nanos = now_nanos
            entry.is_requested = True
            yield part, tries

    def _advance(self, header: Header, now_nanos: int) -> None:
        """Track the gap before a number that is ahead; all before that number was sent."""
        seq_number = header.seq_number
        if self._newest is None:
            # If the sender started just now, its first messages are missing, too.
            is_first_seen = not self._was_reset or seq_number >= MAX_ENTRIES
            self._newest = seq_number if is_first_seen else SEQ_NUMBERS - 1
            self._newest_stamp_nanos = header.stamp_nanos
        ahead = ahead_by(seq_number, self._newest)
        if ahead <= 0:
            return
        due_nanos = now_nanos + self._round_trip.debounce_nanos
        for key, last in self._entries.items():
            if key.seq_number == self._newest and key.parts_max:
                self._mark_sent(last, key.parts_max, due_nanos)
        for back in range(min(ahead - 1, MAX_ENTRIES), 0, -1):
            entry = self._add(NackKey((seq_number - back) % SEQ_NUMBERS), now_nanos)
            entry.due[_WHOLE] = (due_nanos, 0)
            self._wake_at(due_nanos)
        self._newest = seq_number
        self._newest_stamp_nanos = header.stamp_nanos

    def _find(self, header: Header, parts_max: int) -> Optional[NackEntry]:
        """Return the entry of a message by its identity, or by its number alone."""
        entry = self._entries.get(_key_of(header, parts_max))
        return entry if entry is not None else self._entries.get(NackKey(header.seq_number))

    def _identified(self, header: Header) -> Optional[NackEntry]:
        """Return what `_find` does; an entry known by its number alone gets its identity."""
        key = _key_of(header, header.parts_max)
        if key not in self._entries and NackKey(header.seq_number) in self._entries:
            self._entries[key] = self._entries.pop(NackKey(header.seq_number))
        return self._entries.get(key)

    def _add(self, key: NackKey, now_nanos: int) -> NackEntry:
        if len(self._entries) >= MAX_ENTRIES:
            self._entries.popitem(last=False)
        entry = self._entries[key] = NackEntry(now_nanos)
        return entry

    def _mark_sent(self, entry: NackEntry, end: int, due_nanos: int, tries: int = 0) -> None:
        """Mark all parts before `end` as sent; those that have not arrived become due."""
        due = (due_nanos, tries)
        for part in range(entry.highest + 1, end):
            entry.due.setdefault(part, due)
            self._wake_at(due_nanos)
        entry.highest = max(entry.highest, end - 1)

    def _wake_at(self, due_nanos: int) -> None:
        if self._due_nanos is None or due_nanos < self._due_nanos:
            self._due_nanos = due_nanos

    def _measure(self, entry: NackEntry, part: int, now_nanos: int) -> None:
        """Measure the round trip by a part that was requested once (RFC 6298, 2)."""
        tries = entry.due.get(part, entry.due.get(_WHOLE, (0, 0)))[1]
        if tries == 1:
            self._round_trip.add(now_nanos - entry.requested_nanos)


def _key_of(header: Header, parts_max: int) -> NackKey:
    return NackKey(header.seq_number, header.time_sec, header.time_nsec, parts_max)


def _is_next_whole(nack: Nack, seq_number: int) -> bool:
    """Tell whether a whole message can join the request for the ones before it."""
    request = nack.request
    return (
        not request.parts_max
        and request.messages < WHOLE_MAX
        and (nack.seq_number + request.messages) % SEQ_NUMBERS == seq_number
    )
