# SPDX-License-Identifier: Apache-2.0
"""Events, hosts, processes and cables of the model of hosts."""

import heapq
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

SLICE_SECONDS = 3e-3
"""Time for which a process keeps its core while others wait, as with Linux's scheduler."""


class Loop:
    """The events of a run, in order of time."""

    def __init__(self) -> None:
        self.now = 0.0
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0

    def at(self, seconds: float, event: Callable[[], None]) -> None:
        """Have something happen at a time."""
        self._count += 1
        heapq.heappush(self._events, (seconds, self._count, event))

    def run(self, until: float) -> None:
        """Let everything happen until then."""
        while self._events and self._events[0][0] <= until:
            self.now, _, event = heapq.heappop(self._events)
            event()


class Host:
    """A machine whose cores take the processes with work in turn, each for a slice of time."""

    def __init__(self, loop: Loop, cores: int) -> None:
        self.loop, self.cores = loop, cores
        self.busy_seconds = 0.0
        self._free = cores
        self._ready: deque[Process] = deque()

    def wake(self, process: "Process") -> None:
        """Give a process a core as soon as there is one."""
        self._ready.append(process)
        self._dispatch()

    def _dispatch(self) -> None:
        while self._free and self._ready:
            self._free -= 1
            self._start(self._ready.popleft(), self.loop.now + SLICE_SECONDS)

    def _start(self, process: "Process", slice_ends: float) -> None:
        seconds, done = process.jobs.popleft()
        self.busy_seconds += seconds
        process.busy_seconds += seconds
        self.loop.at(self.loop.now + seconds, partial(self._ended, process, done, slice_ends))

    def _ended(self, process: "Process", done: Callable[[], None], slice_ends: float) -> None:
        done()
        if process.jobs and self.loop.now < slice_ends:
            self._start(process, slice_ends)
            return
        self._free += 1
        if process.jobs:
            self._ready.append(process)
        else:
            process.is_ready = False
        self._dispatch()


@dataclass
class Process:
    """A process with one thread."""

    host: Host
    role: str
    busy_seconds: float = 0.0
    jobs: deque[tuple[float, Callable[[], None]]] = field(default_factory=deque)
    is_ready: bool = False

    def do(self, seconds: float, done: Callable[[], None] = lambda: None) -> None:
        """Queue a job, and something that happens at its end."""
        self.jobs.append((seconds, done))
        if not self.is_ready:
            self.is_ready = True
            self.host.wake(self)

    @property
    def behind_seconds(self) -> float:
        """Time that the jobs in the queue will take."""
        return sum(seconds for seconds, _ in self.jobs)


class Cable:
    """One direction of a cable."""

    def __init__(self, loop: Loop, bytes_per_second: float) -> None:
        self.carried = 0
        self._loop, self._rate, self._free_at = loop, bytes_per_second, 0.0

    def carry(self, count: int, arrived: Callable[[], None]) -> None:
        """Carry so many bytes after those that wait."""
        self.carried += count
        self._free_at = max(self._free_at, self._loop.now) + count / self._rate
        self._loop.at(self._free_at, arrived)
