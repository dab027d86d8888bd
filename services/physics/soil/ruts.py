# SPDX-License-Identifier: Apache-2.0
"""Ruts in the making: wheels press the terrain, and what has changed is published tile by tile.

A wheel presses the vertices under it as deep as it has sunk, and finds the mean depth across its
way where it comes to. `ruts.c` computes both. The memory is the tiles that other processes know,
and those that have changed since.
"""

from collections import deque
from ctypes import c_int32, c_size_t, c_void_p

import numpy as np
from msgspec import UNSET, Struct, UnsetType
from numpy.typing import NDArray

from groundlink.messages.base import Ruts
from groundlink.world.ruts import MOST_TILES, NO_RUTS, TILE, RutGrid, digest_of, split
from groundlink.world.terrain import Ground

PUBLISH_TICKS = 40
"""Ticks between two changes of what other processes know."""

MOST_AT_ONCE = 64
"""Tiles of a change; 33 kB."""


class RutMemory(Struct, frozen=True, array_like=True):
    """Ruts of a simulation between two ticks."""

    published: bytes = b""
    """Tiles that other processes know."""

    pending: bytes = b""
    """Tiles that have changed since, in the order of their publication."""


class PressedRuts(RutGrid):
    """The ruts of a terrain while vehicles make them.

    Attributes
    ----------
    published
        the tiles that other processes know, by their keys.
    digest
        of these.
    """

    _fields_ = (  # type: ignore[assignment]  # these follow the fields of the base
        ("_is_pending", c_void_p),
        ("_pending", c_void_p),
        ("_pending_count", c_size_t),
        ("_is_full", c_int32),
    )

    def __init__(self, ground: Ground, memory: RutMemory | None = None) -> None:
        super().__init__(*ground.grid)
        self._flags: NDArray[np.uint8] = np.zeros(MOST_TILES, np.uint8)
        self._queue: NDArray[np.int32] = np.zeros(MOST_TILES, np.int32)
        self._is_pending, self._pending = self._flags.ctypes.data, self._queue.ctypes.data
        memory = memory or RutMemory()
        self.published = tiles_by_key(memory.published)
        self.digest = digest_of(self.published.values())
        self.put(np.frombuffer(memory.published, TILE))
        changed = np.frombuffer(memory.pending, TILE)
        self.put(changed)
        numbers = {int(key): number for number, key in enumerate(self.keys[: self.count])}
        for tile in changed:
            self._flags[number := numbers[int(tile["key"])]] = 1
            self._queue[self._pending_count] = number
            self._pending_count += 1

    def memory(self) -> RutMemory:
        """Return what other ruts of this terrain continue from."""
        pending = b"".join(map(self.tile, self._queue[: self._pending_count]))
        return RutMemory(b"".join(self.published.values()), pending)

    def clear(self) -> None:
        """Level the ground."""
        super().clear()
        self._flags.fill(0)
        self._pending_count = self._is_full = 0
        self.published, self.digest = {}, NO_RUTS

    @property
    def is_full(self) -> bool:
        """Whether ruts were lost for want of tiles."""
        return bool(self._is_full)

    def at(self, tick: int) -> Ruts | UnsetType:
        """Return the ruts that other processes know at a tick; UNSET: none.

        To be called once for each tick.
        """
        if tick % PUBLISH_TICKS == 0 and self._pending_count:
            return self._publish()
        return Ruts(self.digest) if self.published else UNSET

    def _publish(self) -> Ruts:
        numbers = self._queue[: min(self._pending_count, MOST_AT_ONCE)].tolist()
        self._pending_count -= len(numbers)
        self._queue[: self._pending_count] = self._queue[len(numbers) :][: self._pending_count]
        self._flags[numbers] = 0
        changed = tiles_by_key(b"".join(map(self.tile, numbers)))
        replaced = [self.published[key] for key in changed if key in self.published]
        before = self.digest
        self.digest = digest_of([*replaced, *changed.values()], before)
        self.published |= changed
        return Ruts(self.digest, before, memoryview(b"".join(changed.values())))


class RutHistory:
    """The ruts that other processes knew in the last ticks, to serve them by their digest.

    Parameters
    ----------
    now
        the present ruts.
    ticks
        how long ruts are kept.
    """

    def __init__(self, now: PressedRuts, ticks: int) -> None:
        self._first, self._first_digest = dict(now.published), now.digest
        self._changes: deque[tuple[bytes, dict[int, bytes] | None]] = deque()
        self._most = ticks // PUBLISH_TICKS + 1

    def take(self, ruts: Ruts | UnsetType) -> None:
        """Take the ruts of the next tick."""
        digest = ruts.digest if ruts else NO_RUTS
        if digest == (self._changes[-1][0] if self._changes else self._first_digest):
            return
        self._changes.append((digest, tiles_by_key(ruts.tiles) if ruts else None))
        if len(self._changes) > self._most:
            self._first_digest, changed = self._changes.popleft()
            self._first = _changed(self._first, changed)

    def with_digest(self, digest: bytes) -> bytes | None:
        """Return the tiles of ruts; None for unknown ones."""
        tiles, found = dict(self._first), self._first_digest
        for following, changed in self._changes:
            if found == digest:
                break
            tiles, found = _changed(tiles, changed), following
        return b"".join(tiles.values()) if found == digest else None


def _changed(tiles: dict[int, bytes], by: dict[int, bytes] | None) -> dict[int, bytes]:
    """Return tiles after a change; None: the ground is level."""
    return {} if by is None else tiles | by


def tiles_by_key(tiles: bytes | memoryview) -> dict[int, bytes]:
    """Return tiles by their keys."""
    return {int.from_bytes(tile[:8], "little"): tile for tile in split(tiles)}
