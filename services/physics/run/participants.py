# SPDX-License-Identifier: Apache-2.0
"""Participants of a run: which processes physics waits for, and how far each has come.

Ticks and acknowledgements come in as arguments; nothing here reads a clock.
"""

import sys
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping

from groundlink.episode.checkpoint import Checkpoint
from groundlink.messages.base import Ack

Allowance = Callable[[int], int]
"""Returns the last tick that physics may step to when a process has acknowledged a given tick."""


def window(ticks: int) -> Allowance:
    """Let physics be this many ticks ahead."""
    return lambda reached: reached + ticks


def barriers(period_ticks: int) -> Allowance:
    """Let physics leave a barrier (ticks 0, period, 2 periods...) when it is acknowledged.

    So a command that was sent by then acts in the next step, however slow machines and networks
    are.
    """
    return lambda reached: (reached // period_ticks + 1) * period_ticks


class Participants:
    """The processes that physics waits for.

    Parameters
    ----------
    allowances
        what each named process allows.
    needed
        those of them that physics waits for before their first acknowledgement and after they left.
    of_others
        what any other process allows, from its first acknowledgement until it leaves; None:
        everything.
    episode
        of the run; acknowledgements of another one do not count.

    Attributes
    ----------
    absent
        processes that physics does not wait for until they acknowledge again.
    """

    def __init__(
        self,
        allowances: Mapping[str, Allowance],
        *,
        needed: Collection[str] = (),
        of_others: Allowance | None = None,
        episode: int,
    ) -> None:
        self._allowances = dict(allowances)
        self._needed = frozenset(needed)
        self._of_others = of_others
        self._episode = episode
        self._reached: dict[str, int] = {}
        self.absent: frozenset[str] = frozenset()
        self._free_until = -1
        """The last tick that no process holds up, if that is known."""

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Record how far a process has come in this episode."""
        if ack.episode == self._episode and (process in self._allowances or self._of_others):
            self._reached[process] = ack.tick
            self.absent -= {process}
            self._free_until = -1

    def has_followed(self, process: str) -> bool:
        """Return whether a process has acknowledged a state of this episode."""
        return self._reached.get(process, -1) >= 0

    def left(self, process: str) -> None:
        """Stop waiting for a process that has left, unless the run needs it."""
        if process not in self._needed:
            self._reached.pop(process, None)
            self.absent -= {process}
            self._free_until = -1

    def only(self, wanted: Collection[str]) -> None:
        """Wait for none of the named processes but these."""
        for process in self._allowances.keys() - wanted:
            del self._allowances[process]
            self._reached.pop(process, None)
        self._free_until = -1
        self._needed &= frozenset(wanted)
        self.absent &= frozenset(self._reached) | self._needed

    def mark_absent(self, process: str) -> None:
        """Stop waiting for a process until it acknowledges again."""
        self.absent |= {process}
        self._free_until = -1

    def missing(self, tick: int) -> list[str]:
        """Return the processes that hold up the step to `tick`."""
        if tick <= self._free_until:
            return []
        names = (self._needed | self._reached.keys()) - self.absent
        allowed = {name: self._allowed_by(name) for name in names}
        self._free_until = min(allowed.values(), default=sys.maxsize)
        return sorted(name for name, last in allowed.items() if last < tick)

    def _allowed_by(self, process: str) -> int:
        """Return the last tick that a process allows; -1 before its first acknowledgement."""
        if (reached := self._reached.get(process)) is None:
            return -1
        allowance = self._allowances.get(process, self._of_others)
        return sys.maxsize if allowance is None else allowance(reached)


NO_COMMAND = (-1, 0)


class PendingAcks:
    """Acknowledgements that wait for the commands that they refer to.

    The bus keeps the order within a key, not that of a command and an acknowledgement.
    """

    def __init__(self) -> None:
        self._pending: dict[str, Ack] = {}
        self._commanded: dict[str, tuple[int, int]] = {}
        """By vehicle: the newest tick of a command, and the number of commands with it."""

    def __len__(self) -> int:
        return len(self._pending)

    def commanded(self, vehicle: str, tick: int) -> None:
        """Record a command for `vehicle` that is stamped with `tick`."""
        newest, count = self._commanded.get(vehicle, NO_COMMAND)
        if tick >= newest:
            self._commanded[vehicle] = tick, count + 1 if tick == newest else 1

    def assume(self, ack: Ack) -> None:
        """Count the commands that an acknowledgement of a predecessor refers to as come."""
        for vehicle, tick in ack.commanded.items():
            count = (ack.commands or {}).get(vehicle, 0)
            known = self._commanded.get(vehicle, NO_COMMAND)
            self._commanded[vehicle] = max(known, (tick, count))

    def add(self, process: str, ack: Ack) -> None:
        """Add an acknowledgement; it replaces an earlier one of its process."""
        self._pending[process] = ack

    def take_complete(self) -> Iterator[tuple[str, Ack]]:
        """Remove and yield each acknowledgement whose commands have come, with its process."""
        for process, ack in list(self._pending.items()):
            counts = ack.commands or {}
            needed = ((v, (tick, counts.get(v, 0))) for v, tick in ack.commanded.items())
            if all(self._commanded.get(v, NO_COMMAND) >= command for v, command in needed):
                yield process, self._pending.pop(process)


class CheckpointAcks:
    """Checkpoints of an episode, each complete when all processes have published what is before it.

    Attributes
    ----------
    complete
        in the order of their ticks.
    """

    def __init__(self) -> None:
        self.complete: list[Checkpoint] = []
        self._open: deque[tuple[Checkpoint, set[str]]] = deque()

    def add(self, checkpoint: Checkpoint, processes: Iterable[str]) -> None:
        """Add a checkpoint that waits for acknowledgements of processes."""
        self._open.append((checkpoint, set(processes)))
        self._complete()

    def acknowledged(self, process: str, ack: Ack) -> None:
        """Take an acknowledgement of the episode, in the order in which its process sent it."""
        for checkpoint, awaited in self._open:
            if process in awaited and ack.settled_tick >= checkpoint.tick:
                awaited.discard(process)
                checkpoint.acks[process] = ack
        self._complete()

    def left(self, process: str) -> None:
        """Complete checkpoints without a process that has left."""
        for _, awaited in self._open:
            awaited.discard(process)
        self._complete()

    def _complete(self) -> None:
        while self._open and not self._open[0][1]:
            self.complete.append(self._open.popleft()[0])
