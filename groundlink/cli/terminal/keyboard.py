# SPDX-License-Identifier: Apache-2.0
"""Driving by keys: which velocity is asked for after which key, and for how long.

Rule: keys and wall time come in as arguments. A terminal tells no release of a key, so what was
asked for ends when no key has come for half a second: who lets go stops.
"""

from __future__ import annotations

from collections.abc import Iterator

DEAD_MAN_SECONDS = 0.5

FASTER = 1.1
"""What one press of a key for speed changes."""

ARROWS = {b"\x1b[A": "w", b"\x1b[B": "s", b"\x1b[C": "d", b"\x1b[D": "a"}
"""What terminals send for arrows (ECMA-48's CUU, CUD, CUF, CUB), as the letters beside them."""

HELP = "w a s d or arrows drive, space stops, + - speed, ] [ turning, q ends"


def keys(typed: bytes) -> Iterator[str]:
    """Yield the keys that a terminal's bytes stand for; other escape sequences are none."""
    while typed:
        if typed[:1] == b"\x1b":
            sequence, typed = typed[:3], typed[3:]
            if sequence in ARROWS:
                yield ARROWS[sequence]
        else:
            yield chr(typed[0]).lower()
            typed = typed[1:]


class Keyboard:
    """The velocity that keys ask for.

    Parameters
    ----------
    speed_mps, turn_radps
        what the first press asks for.
    most_mps
        what the vehicle can drive.
    """

    def __init__(self, *, speed_mps: float = 0.5, turn_radps: float = 0.8, most_mps: float) -> None:
        self._most_mps = most_mps
        self.speed_mps = min(speed_mps, most_mps)
        self.turn_radps = turn_radps
        self._ahead = self._left = 0
        self._pressed_seconds = -DEAD_MAN_SECONDS

    def pressed(self, key: str, now_seconds: float) -> None:
        """Take note of a key; an unknown one changes nothing and holds nothing."""
        if key in "ws":
            self._ahead, self._left = (1 if key == "w" else -1), 0
        elif key in "ad":
            self._left = 1 if key == "a" else -1
            if self._is_over(now_seconds):
                self._ahead = 0
        elif key == " ":
            self._ahead = self._left = 0
        elif key in "+=":
            self.speed_mps = min(self.speed_mps * FASTER, self._most_mps)
        elif key == "-":
            self.speed_mps /= FASTER
        elif key == "]":
            self.turn_radps *= FASTER
        elif key == "[":
            self.turn_radps /= FASTER
        else:
            return
        if key in "wasd ":
            self._pressed_seconds = now_seconds

    def twist(self, now_seconds: float) -> tuple[float, float]:
        """Return the velocity that is asked for now: m/s ahead, rad/s to the left."""
        if self._is_over(now_seconds):
            self._ahead = self._left = 0
        return self._ahead * self.speed_mps, self._left * self.turn_radps

    def _is_over(self, now_seconds: float) -> bool:
        return now_seconds - self._pressed_seconds > DEAD_MAN_SECONDS
