# SPDX-License-Identifier: Apache-2.0
"""How far those have come whose data ROS is to have before it is asked.

Rule: bookkeeping; what is done of it is the business of `lockstep`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence


class SensorProgress:
    """The sensors of a run, or physics where it has none."""

    def __init__(self, names: Sequence[str]) -> None:
        self._names = names
        self._reached: dict[str, tuple[int, int]] = {}
        self._left_out: set[str] = set()

    def told(self, name: str, life: int, tick: int) -> None:
        """Take note of how far one has come."""
        self._reached[name] = life, tick
        self._left_out.discard(name)

    def all_told(self, life: int, tick: int) -> None:
        """Take it that all have come so far."""
        self._reached = dict.fromkeys(self._names, (life, tick))

    def do_without(self, names: Iterable[str]) -> None:
        """Wait for these no longer before they are heard again."""
        self._left_out |= set(names)

    def behind(self, life: int, tick: int) -> list[str]:
        """Return who is waited for and has not come to a tick."""
        reached = self._reached.items()
        there = {name for name, told in reached if told[0] == life and told[1] >= tick}
        return [name for name in self._names if name not in there | self._left_out]
