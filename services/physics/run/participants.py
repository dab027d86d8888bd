# SPDX-License-Identifier: Apache-2.0
"""Who takes part in a run, how far each has come, and whose word counts already.

Rule: ticks and acknowledgements come in as arguments; nothing here knows what time it is.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping

from groundlink.messages.base import Ack

AckRequirement = Callable[[int], int]
"""Returns the tick that a process must have acknowledged before physics steps to another one."""


def window(ticks: int) -> AckRequirement:
    """Let physics be so many ticks ahead."""
    return lambda tick: tick - ticks


def barriers(period_ticks: int) -> AckRequirement:
    """Let physics go on from a barrier, the ticks 0, period, 2 periods, with a word on that one.

    So what was commanded by then acts in the next step, whatever machines and networks do.
    """
    return lambda tick: (tick - 1) // period_ticks * period_ticks


class Participants:
    """The processes that are waited for.

    Parameters
    ----------
    demands
        what is asked of each process by name.
    needed
        those of them that are waited for before their first word and after they left.
    of_others
        what is asked of any other process, from its first word until it leaves; None: nothing.
    episode
        of the run: what was said in another one does not count.
    """

    def __init__(
        self,
        requirements: Mapping[str, AckRequirement],
        *,
        needed: Collection[str] = (),
        of_others: AckRequirement | None = None,
        episode: int,
    ) -> None:
        self._requirements = dict(requirements)
        self._needed = frozenset(needed)
        self._of_others = of_others
        self._episode = episode
        self._reached: dict[str, int] = {}
        self.given_up: frozenset[str] = frozenset()
        """Who is counted as absent until it is heard again."""

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take note of how far a process has come in this episode of the run."""
        if ack.life == self._episode and (process in self._requirements or self._of_others):
            self._reached[process] = ack.tick
            self.given_up -= {process}

    def has_followed(self, process: str) -> bool:
        """Return whether a process has acknowledged a state of this episode."""
        return self._reached.get(process, -1) >= 0

    def left(self, process: str) -> None:
        """Stop waiting for a process that has gone, unless the run needs it."""
        if process not in self._needed:
            self._reached.pop(process, None)
            self.given_up -= {process}

    def only(self, wanted: Collection[str]) -> None:
        """Wait no longer for those that something was asked of and that are not among these."""
        for process in self._requirements.keys() - wanted:
            del self._requirements[process]
            self._reached.pop(process, None)
        self._needed &= frozenset(wanted)
        self.given_up &= frozenset(self._reached) | self._needed

    def give_up(self, process: str) -> None:
        """Count a process as absent until it says something again."""
        self.given_up |= {process}

    def missing(self, tick: int) -> list[str]:
        """Return the processes that hold up the step to `tick`."""
        names = (self._needed | self._reached.keys()) - self.given_up
        return sorted(name for name in names if self._lacks(name, tick))

    def _lacks(self, process: str, tick: int) -> bool:
        reached = self._reached.get(process)
        requirement = self._requirements.get(process, self._of_others)
        return reached is None or (requirement is not None and reached < requirement(tick))


class PendingAcks:
    """Holds acknowledgements back until the commands that they speak of are here.

    The bus keeps the order of one key, not that of a command and an acknowledgement.
    """

    def __init__(self) -> None:
        self._held: dict[str, Ack] = {}
        self._commanded: dict[str, int] = {}

    def commanded(self, vehicle: str, tick: int) -> None:
        """Take note of a command for `vehicle` that is stamped with `tick`."""
        self._commanded[vehicle] = max(tick, self._commanded.get(vehicle, -1))

    def given(self, process: str, ack: Ack) -> None:
        """Take an acknowledgement."""
        self._held[process] = ack

    def kept(self) -> Iterator[tuple[str, Ack]]:
        """Yield each process and acknowledgement that holds now, once."""
        for process, ack in list(self._held.items()):
            if all(self._commanded.get(v, -1) >= tick for v, tick in ack.commanded.items()):
                yield process, self._held.pop(process)
