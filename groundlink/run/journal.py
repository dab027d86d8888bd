# SPDX-License-Identifier: Apache-2.0
"""A run's journal: all that physics needs to do the same again, and the last words of the others.

Rule: physics is deterministic, so what it was told, and before which step, is its state. A journal
that is read again and stepped through gives the world of its last tick; with it go the last
acknowledgements of sensors, drivers and the gateway, from which each goes on as after a crash. The
same bytes travel over the bus and lie in a file: a line of text, then MessagePack. What is in them
is data and nothing that runs.
"""

from __future__ import annotations

import hashlib
import os
import platform
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib import metadata
from pathlib import Path

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from groundlink.core.atomic_file import write_atomically
from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack, Command, State, WheelCommand, encode
from groundlink.messages.control import Remove, Spawn
from groundlink.messages.navigation import JointState
from groundlink.scenario import Scenario

VERSION = 1

_FIRST_LINE = b"groundlink journal "
_FIRST_LINE_BYTES = 128
"""More than it is long."""

PART_BYTES = 2**20
"""Of a journal in one reply on the bus, so that states need not wait for all of it."""


BLOCK_ENTRIES = 1024
"""That are compressed together."""

MOST_BLOCK_BYTES = 1 << 28
"""Of one block: a scenario has megabytes at most, whatever somebody has put into a file."""

_LENGTH = struct.Struct("<I")


class Entry(Struct, frozen=True, array_like=True, tag=True):
    """Something that physics took in between two steps."""

    tick: int
    """The last one that was stepped to before."""


class Commanded(Entry, frozen=True, tag="command"):
    """A velocity that a vehicle was asked for."""

    vehicle: str
    command: Command
    """Stamped in nanoseconds of sim time, whatever the epoch."""


class WheelsCommanded(Entry, frozen=True, tag="wheels"):
    """What single wheels were asked for."""

    vehicle: str
    command: WheelCommand
    """As above."""


class JointsCommanded(Entry, frozen=True, tag="joints"):
    """Where joints were asked to go."""

    vehicle: str
    command: JointState
    """As above."""


class Changed(Entry, frozen=True, tag="world"):
    """Something that was put into the world or taken out."""

    wish: Spawn | Remove


AnyEntry = Commanded | WheelsCommanded | JointsCommanded | Changed

_ENTRY = msgspec.msgpack.Decoder(AnyEntry)

encode_entry = msgspec.msgpack.Encoder().encode
"""Returns an entry as a journal holds it."""


class Machine(Struct, frozen=True):
    """What the last bits of a sum depend on."""

    processor: str
    versions: dict[str, str]

    def unlike(self, other: Machine) -> str:
        """Return what this one has otherwise than another; empty for nothing."""
        found = [self.processor] if self.processor != other.processor else []
        for name, version in self.versions.items():
            if version != other.versions.get(name):
                found.append(f"{name} {version}")
        return ", ".join(found)


class Journal(Struct, frozen=True, kw_only=True):
    """One life of a run, from tick 0 to a tick."""

    made_on: Machine
    run: str
    life: int
    """See `State.life`."""

    epoch_nanos: int
    """Stamp of sim time zero."""

    scenario: Scenario
    """As it was at tick 0."""

    tick: int
    """The last one that was stepped to; what came after it and acts later is among the entries."""

    digest: str
    """Of the state at that tick, see `state_digest`."""

    entries: tuple[bytes, ...]
    """Each one an entry as MessagePack, in the order in which they were taken in."""

    left_out: int = 0
    """How many entries came before these: who asks again and again need not get all each time."""

    acks: dict[str, Ack] = {}
    """The last word of every process, by name."""

    def read(self) -> Iterator[AnyEntry]:
        """Yield the entries."""
        return map(_ENTRY.decode, self.entries)

    def still_there(self) -> Scenario:
        """Return the scenario without the vehicles that were taken out since its start."""
        wishes = (entry.wish for entry in self.read() if isinstance(entry, Changed))
        gone = {wish.name for wish in wishes if isinstance(wish, Remove)}
        there = tuple(v for v in self.scenario.vehicles if v.name not in gone)
        return replace(self.scenario, vehicles=there)

    def followed_by(self, later: Journal) -> Journal:
        """Return a later journal of the same life with what it leaves out, as far as it is here.

        Raises
        ------
        ValueError
            when it is of another life, or leaves out more.
        """
        if later.life != self.life or later.left_out > len(self.entries):
            raise ValueError("not the continuation of this journal")
        return replace(later, entries=self.entries[: later.left_out] + later.entries, left_out=0)


def acting_before(
    tick: int, entries: Iterable[bytes]
) -> tuple[tuple[bytes, ...], tuple[bytes, ...]]:
    """Split entries into those that act before a tick, and the others as they were.

    A command is moved to the tick of its stamp, from which it acts, but never beyond a change of
    the world. So the first part does not depend on how early commands arrived.
    """
    placed = []
    part, limit = 0, 2**63
    for raw in reversed(tuple(entries)):
        entry = _ENTRY.decode(raw)
        if isinstance(entry, Changed):
            limit = entry.tick
            placed.append(((part - 1, limit, ""), raw, raw))
            part -= 2
            continue
        acts = min(max(entry.tick, entry.command.stamp_nanos // TICK_NANOS), limit)
        moved = encode_entry(replace(entry, tick=acts))
        placed.append(((part, acts, entry.vehicle), moved, raw))
    placed.reverse()
    later = tuple(raw for (_, acts, _), _, raw in placed if acts >= tick)
    earlier = sorted((p for p in placed if p[0][1] < tick), key=lambda p: p[0])
    return tuple(moved for _, moved, _ in earlier), later


class JournalError(UserError):
    """A journal that cannot be read, and why."""


def state_digest(state: State) -> str:
    """Return the sha256 of a state, whatever its run and life are called and its epoch is."""
    plain = replace(state, run="", life=0, epoch_nanos=0)
    return hashlib.sha256(encode(plain)).hexdigest()


@cache
def this_machine() -> Machine:
    """Return what this process computes with."""
    names = ("groundlink", "pybullet", "numpy")
    versions = {"python": platform.python_version()}
    for name in names:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return Machine(_processor(), versions)


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.machine()


def dumped(journal: Journal) -> bytes:
    """Return a journal as a file has it.

    That of an hour takes a fifth of a second; in blocks, so that other threads are not held up.
    """
    content = msgspec.msgpack.Encoder()
    entries = journal.entries
    blocks: list[object] = [replace(journal, entries=())]
    blocks += [entries[i : i + BLOCK_ENTRIES] for i in range(0, len(entries), BLOCK_ENTRIES)]
    packed = (zlib.compress(content.encode(block), 1) for block in blocks)
    body = b"".join(part for block in packed for part in (_LENGTH.pack(len(block)), block))
    digest = hashlib.sha256(body).hexdigest().encode()
    return b"%s%d %s\n%s" % (_FIRST_LINE, VERSION, digest, body)


def loaded(content: bytes, where: str) -> Journal:
    """Return the journal that `content` holds; `where` names it in errors.

    Raises
    ------
    JournalError
        with one line, when it holds none, or one that this version cannot read.
    """
    line, newline, _ = content[:_FIRST_LINE_BYTES].partition(b"\n")
    words = line.removeprefix(_FIRST_LINE).split()
    if not line.startswith(_FIRST_LINE) or not newline or len(words) != 2 or not words[0].isdigit():
        raise JournalError(f"{where}: no saved run; expected a file that `groundlink save` wrote")
    if int(words[0]) != VERSION:
        raise JournalError(
            f"{where}: a saved run of format {int(words[0])}; this version of Groundlink reads "
            f"format {VERSION}, so restore it by the one that saved it"
        )
    body = memoryview(content)[len(line) + 1 :]
    if hashlib.sha256(body).hexdigest().encode() != words[1]:
        raise JournalError(f"{where}: cut off or damaged; save the run again, or copy it again")
    try:
        blocks = _blocks(body)
        head = msgspec.msgpack.decode(next(blocks), type=Journal)
        more = (msgspec.msgpack.decode(block, type=tuple[bytes, ...]) for block in blocks)
        journal = replace(head, entries=tuple(entry for part in more for entry in part))
        for _ in journal.read():
            pass
    except (msgspec.DecodeError, zlib.error, struct.error, StopIteration) as error:
        raise JournalError(
            f"{where}: saved by a version of Groundlink whose scenarios are others ({error}); "
            "restore it by that version"
        ) from None
    return journal


def _blocks(body: memoryview) -> Iterator[bytes]:
    at = 0
    while at < len(body):
        (size,) = _LENGTH.unpack_from(body, at)
        at += _LENGTH.size + size
        yield zlib.decompressobj().decompress(body[at - size : at], MOST_BLOCK_BYTES)


def write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; one that is there is replaced.

    Raises
    ------
    UserError
        when it cannot be written.
    """
    with write_atomically(path) as part, part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def read(path: Path) -> bytes:
    """Return a file's content.

    Raises
    ------
    JournalError
        when it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise JournalError(
            f"cannot read {path}: {(error.strerror or str(error)).lower()}"
        ) from None


def is_saved_run(path: Path) -> bool:
    """Return whether a file says that it is one; what cannot be read does not."""
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(_FIRST_LINE)) == _FIRST_LINE
    return False


def parts(content: bytes) -> list[bytes]:
    """Return a journal's bytes as replies to one query, in order."""
    return [content[i : i + PART_BYTES] for i in range(0, len(content), PART_BYTES)]
