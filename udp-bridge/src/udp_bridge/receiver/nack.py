# SPDX-License-Identifier: Apache-2.0
"""What a receiver asks a sender to send again, of one topic, and when.

A topic is asked for only while its sender offers it, and only as long as a message is not older
than the offer's limit. Nothing here waits: what arrives of a topic, offers among it, is when it
is asked whether something is due. How long to wait is `round_trip`'s, parts and bodies are
`assembly`'s.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Iterator, List, NamedTuple, Optional, Tuple

from udp_bridge.wire.header import SEQ_NUMBERS, Header
from udp_bridge.wire.repair import WHOLE_MAX, Offer, Request, parts_of

from .nack_entry import Want
from .ordering import MOST_AHEAD
from .round_trip import RoundTrip

COPIES = 3
"""A repetition goes out twice, the third and later ones so often: requests are small, and loss in
bursts would take one after the other. The sender takes copies for one."""
TRIES = 16
WANTS = 64
"""Messages of a topic that are asked for; older ones give way."""

_WHOLE = -1
"""Stands for all parts of a message of which nothing came."""


class WantKey(NamedTuple):
    """Identity of a missed message: two messages of a sender may share a seq_number."""

    seq_number: int
    time_sec: int = 0
    time_nsec: int = 0
    parts_max: int = 0
    """0, with time 0, while no part of the message has arrived: only its number is known."""


class Asked(NamedTuple):
    """A request and the header fields that go with it."""

    seq_number: int
    time: Tuple[int, int]
    request: Request
    copies: int = 1


class Asking:
    """The gaps of one topic of one sender."""

    def __init__(self) -> None:
        self._limit_nanos = 0
        self._newest: Optional[int] = None
        self._newest_stamp_nanos = 0
        self._is_reborn = False
        self._wants: OrderedDict[WantKey, Want] = OrderedDict()  # oldest first
        self._due_nanos: Optional[int] = None  # no part is due before
        self._round_trip = RoundTrip()

    def is_wanted(self, header: Header, now_nanos: int) -> bool:
        """Tell whether a message was missed, or came in part, and is not stale."""
        want = self._find(header, header.parts_max)
        return want is not None and now_nanos - want.since_nanos <= self._limit_nanos

    def is_of_new_life(self, header: Header) -> bool:
        """Tell whether a message that is neither wanted nor known shows a restarted sender.

        A sender that was not restarted has numbered later what is newer; and what it sends again
        was missed here.
        """
        newest = self._newest
        is_ahead = newest is None or _ahead(header.seq_number, newest) > 0
        return not is_ahead and header.stamp_nanos > self._newest_stamp_nanos

    def is_jump(self, seq_number: int, most_behind: int) -> bool:
        """Tell whether a number is too far from the newest one to be believed alone."""
        if self._newest is None:
            return False
        return not -most_behind <= _ahead(seq_number, self._newest) < MOST_AHEAD

    def spans(self, nanos: int) -> bool:
        """Tell whether a message may be sent again when this much time has passed."""
        return nanos <= self._limit_nanos

    def is_asked(self, header: Header) -> bool:
        """Tell whether something of a message was asked for."""
        want = self._find(header, header.parts_max)
        return want is not None and want.is_asked

    def is_next(self, header: Header) -> bool:
        """Tell whether a message is the next one and nothing before it is missing."""
        newest = self._newest
        return (
            newest is not None
            and header.seq_number == (newest + 1) % SEQ_NUMBERS
            and not self._wants
            and self._due_nanos is None
        )

    @property
    def patience(self) -> Tuple[int, int]:
        """When something is to be asked for, 0 when nothing is; and how long behind a gap."""
        return self._due_nanos or 0, self._round_trip.debounce_nanos

    def offered(self, header: Header, offer: Offer, *, is_finished: bool, now_nanos: int) -> None:
        """Take the sender's word that the message in the header was sent altogether.

        Parameters
        ----------
        is_finished
            Nothing is missing of that message.
        """
        self._limit_nanos = offer.limit_ms * 1_000_000
        newest = self._newest
        is_known = newest is not None and _ahead(header.seq_number, newest) <= 0
        self._advance(header, now_nanos)
        want = self._find(header, offer.parts_max)
        if want is None and not is_known and not is_finished:
            want = self._want(WantKey(header.seq_number), now_nanos)
            want.due[_WHOLE] = (now_nanos, 0)
        if want is None:
            return
        if _WHOLE not in want.due:
            self._is_sent_up_to(want, offer.parts_max, now_nanos)
        want.offered(now_nanos, self._round_trip.usual_nanos)
        self._due_nanos = now_nanos

    def saw(self, header: Header, *, is_whole: bool, now_nanos: int, count: int = 1) -> None:
        """Take note of a part that came; `is_whole` when its message is complete now.

        Or of so many parts in a row, of which the header is that of the first.
        """
        seq_number, first = header.seq_number, header.part_number
        self._advance(header, now_nanos)
        want = self._identified(header)
        if is_whole:
            if want is not None:
                self._measure(want, first, now_nanos)
                self.finished(header)
            if not self._wants:
                self._due_nanos = None
            return
        if want is None:
            want = self._want(_key_of(header, header.parts_max), now_nanos)
        whole = want.due.pop(_WHOLE, None)
        if whole is not None or seq_number != self._newest:
            # It was sent long since, and what was asked for as a whole is on its way.
            wait = (
                self._round_trip.wait_nanos(whole[1])
                if whole and whole[1]
                else self._round_trip.debounce_nanos
            )
            tries = whole[1] if whole else 0
            self._is_sent_up_to(want, header.parts_max, now_nanos + wait, tries)
        self._measure(want, first, now_nanos)
        if want.due:
            again_nanos = now_nanos + self._round_trip.debounce_nanos
            if want.lost_again(first, again_nanos):
                self._wake_at(again_nanos)
            for part in range(first, first + count):
                want.due.pop(part, None)
        due_nanos = now_nanos + self._round_trip.debounce_nanos
        if want.is_asked:  # one request a round trip serves all gaps that are found meanwhile
            due_nanos = max(due_nanos, want.asked_nanos + self._round_trip.nanos)
        self._is_sent_up_to(want, first, due_nanos)
        want.highest = max(want.highest, first + count - 1)

    def has_asked(self, header: Header, bitmap: bytes, asked_nanos: int, now_nanos: int) -> None:
        """Take note of a request that went out where the parts of a message are received.

        It was due then, and the first of this message; the parts that came are told by `saw`.
        """
        self._advance(header, now_nanos)
        key = _key_of(header, header.parts_max)
        want = self._identified(header) or self._want(key, now_nanos)
        want.is_asked, want.asked_nanos = True, asked_nanos
        due = (asked_nanos + self._round_trip.wait_nanos(0), 1)
        parts = parts_of(bitmap)
        want.due.update(dict.fromkeys(parts, due))
        want.highest = max(want.highest, *parts)
        self._wake_at(due[0])

    def finished(self, header: Header) -> None:
        """Ask no more for a message that is whole or was given up."""
        self._wants.pop(_key_of(header, header.parts_max), None)

    def forget(self) -> None:
        """Begin anew, as with a sender that was restarted."""
        self._newest = None
        self._is_reborn = True
        self._wants.clear()
        self._due_nanos = None

    def due(self, msg_type: int, now_nanos: int) -> List[Asked]:
        """Return what to ask for now; the goodput is for the caller to fill in."""
        if self._due_nanos is None or now_nanos < self._due_nanos:
            return []
        for key, want in list(self._wants.items()):
            if now_nanos - want.since_nanos > self._limit_nanos:
                del self._wants[key]
        asked = []
        for (seq_number, sec, nsec, parts_max), want in self._wants.items():
            tries = 0
            taken = []
            for part, part_tries in self._take_due(want, now_nanos):
                taken.append(part)
                tries = max(tries, part_tries)
            if not taken:
                continue
            parts = tuple(sorted(taken))
            copies = min(1 + (tries + 1) // 2, COPIES)
            if parts != (_WHOLE,):
                request = Request(msg_type, parts_max, 1, 0, parts)
                asked.append(Asked(seq_number, (sec, nsec), request, copies))
            elif asked and _follows(asked[-1], seq_number):
                last = asked[-1]
                request = last.request._replace(messages=last.request.messages + 1)
                asked[-1] = last._replace(request=request)
            else:
                asked.append(Asked(seq_number, (0, 0), Request(msg_type, 0, 1, 0), copies))
        dues = [due for want in self._wants.values() for due, _ in want.due.values()]
        self._due_nanos = min(dues) if dues else None
        return asked

    def _take_due(self, want: Want, now_nanos: int) -> Iterator[Tuple[int, int]]:
        """Yield the parts that are due now, and how often they were asked for, and put them off."""
        for part, (due_nanos, tries) in list(want.due.items()):
            if due_nanos > now_nanos:
                continue
            if tries >= TRIES:
                del want.due[part]
                continue
            want.due[part] = (now_nanos + self._round_trip.wait_nanos(tries), tries + 1)
            want.asked_nanos = now_nanos
            want.is_asked = True
            yield part, tries

    def _advance(self, header: Header, now_nanos: int) -> None:
        """Find the gap before a number that is ahead; what is behind it was sent altogether."""
        seq_number = header.seq_number
        if self._newest is None:
            # Of a sender that began before our eyes the first messages are missed, too.
            is_first_seen = not self._is_reborn or seq_number >= WANTS
            self._newest = seq_number if is_first_seen else SEQ_NUMBERS - 1
            self._newest_stamp_nanos = header.stamp_nanos
        ahead = _ahead(seq_number, self._newest)
        if ahead <= 0:
            return
        later_nanos = now_nanos + self._round_trip.debounce_nanos
        for key, last in self._wants.items():
            if key.seq_number == self._newest and key.parts_max:
                self._is_sent_up_to(last, key.parts_max, later_nanos)
        for back in range(min(ahead - 1, WANTS), 0, -1):
            want = self._want(WantKey((seq_number - back) % SEQ_NUMBERS), now_nanos)
            want.due[_WHOLE] = (later_nanos, 0)
            self._wake_at(later_nanos)
        self._newest = seq_number
        self._newest_stamp_nanos = header.stamp_nanos

    def _find(self, header: Header, parts_max: int) -> Optional[Want]:
        """Return what is missed of a message, if anything is."""
        want = self._wants.get(_key_of(header, parts_max))
        return want if want is not None else self._wants.get(WantKey(header.seq_number))

    def _identified(self, header: Header) -> Optional[Want]:
        """Return what `_find` does; a message known by its number alone gets its identity."""
        key = _key_of(header, header.parts_max)
        if key not in self._wants and WantKey(header.seq_number) in self._wants:
            self._wants[key] = self._wants.pop(WantKey(header.seq_number))
        return self._wants.get(key)

    def _want(self, key: WantKey, now_nanos: int) -> Want:
        if len(self._wants) >= WANTS:
            self._wants.popitem(last=False)
        want = self._wants[key] = Want(now_nanos)
        return want

    def _is_sent_up_to(self, want: Want, end: int, due_nanos: int, tries: int = 0) -> None:
        """Take all parts before `end` as sent; those that have not come are due then."""
        due = (due_nanos, tries)
        for part in range(want.highest + 1, end):
            want.due.setdefault(part, due)
            self._wake_at(due_nanos)
        want.highest = max(want.highest, end - 1)

    def _wake_at(self, due_nanos: int) -> None:
        if self._due_nanos is None or due_nanos < self._due_nanos:
            self._due_nanos = due_nanos

    def _measure(self, want: Want, part: int, now_nanos: int) -> None:
        """Measure the round trip by a part that was asked for once (RFC 6298, 2)."""
        tries = want.due.get(part, want.due.get(_WHOLE, (0, 0)))[1]
        if tries == 1:
            self._round_trip.measured(now_nanos - want.asked_nanos)


def _key_of(header: Header, parts_max: int) -> WantKey:
    return WantKey(header.seq_number, header.time_sec, header.time_nsec, parts_max)


def _ahead(seq_number: int, other: int) -> int:
    difference = (seq_number - other) % SEQ_NUMBERS
    return difference if difference < SEQ_NUMBERS // 2 else difference - SEQ_NUMBERS


def _follows(asked: Asked, seq_number: int) -> bool:
    """Tell whether a message can be asked for as one more of `asked`."""
    request = asked.request
    return (
        not request.parts_max
        and request.messages < WHOLE_MAX
        and (asked.seq_number + request.messages) % SEQ_NUMBERS == seq_number
    )
