# SPDX-License-Identifier: Apache-2.0
"""What became of each message of one topic, by its number: one fate each, counted once.

Only seq_numbers come in. The last `REMEMBERED` are told apart one by one; an older number keeps
the fate that it had, and one without any is missing for good, whatever comes of it later.
"""

from __future__ import annotations

from udp_bridge.wire.header import SEQ_NUMBERS

REMEMBERED = 1024
"""Numbers behind the highest one that can still get a fate."""
_MASK = (1 << REMEMBERED) - 1


class Fates:
    """The numbers of one topic in one life of its sender, from the first that was seen.

    It holds at any time that `numbers` = handed + incomplete + late + `open_count` + missing.
    """

    __slots__ = (
        "_came",
        "_highest",
        "_mended",
        "_settled",
        "first_number",
        "handed",
        "incomplete",
        "late",
        "numbers",
        "repaired",
    )

    def __init__(self) -> None:
        self.first_number = 0
        """The lowest that was seen and is remembered; what is behind it counts nowhere."""
        self.numbers = 0
        """From the first to the highest number seen, both included."""
        self.handed = 0
        self.incomplete = 0
        self.late = 0
        self.repaired = 0
        """Of those handed over, the ones that would be incomplete without repair."""
        self._highest = 0
        self._came = self._settled = self._mended = 0  # bit 0 is the highest number's

    @property
    def open_count(self) -> int:
        """Messages of which a part came and whose fate is open."""
        return bin(self._came & ~self._settled).count("1")

    def seen(self, seq_number: int) -> None:
        """Take note that a part of a message came."""
        if not self.numbers:
            self.first_number = self._highest = seq_number
            self.numbers = self._came = 1
            return
        if seq_number == self._highest:
            return
        ahead = (seq_number - self._highest) % SEQ_NUMBERS
        if ahead >= SEQ_NUMBERS // 2:
            behind = SEQ_NUMBERS - ahead
            if self.numbers <= behind < REMEMBERED:  # overtaken, or sent again
                self.first_number, self.numbers = seq_number, behind + 1
            self._came |= self._bit(seq_number)
            return
        # A number may be forged: no shift by what is not remembered anyway.
        shift = min(ahead, REMEMBERED)
        self._came = (self._came << shift | 1) & _MASK
        self._settled = self._settled << shift & _MASK
        self._mended = self._mended << shift & _MASK
        self._highest = seq_number
        self.numbers += ahead

    def mended(self, seq_number: int) -> None:
        """Take note that a part of an open message came by repair."""
        self.seen(seq_number)
        self._mended |= self._bit(seq_number)

    def settle(self, seq_number: int, fate: str) -> bool:
        """Give a message its fate, `handed`, `incomplete` or `late`; return whether it counts."""
        if seq_number != self._highest or not self.numbers:
            self.seen(seq_number)
        bit = 1 if seq_number == self._highest else self._bit(seq_number)
        if not bit & ~self._settled:
            return False
        self._settled |= bit
        setattr(self, fate, getattr(self, fate) + 1)
        if fate == "handed" and self._mended & bit:
            self.repaired += 1
        return True

    def _bit(self, seq_number: int) -> int:
        """Return the bit of a number, or 0 when it is too old."""
        behind = (self._highest - seq_number) % SEQ_NUMBERS
        return 1 << behind if behind < min(self.numbers, REMEMBERED) else 0
