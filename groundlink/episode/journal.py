# SPDX-License-Identifier: Apache-2.0
"""Journal of a run: the inputs of physics, and the last acknowledgements of other processes.

Physics is deterministic, so its inputs with their ticks determine its state: stepping through a
journal reproduces the world of its last tick. Sensors, drivers and the gateway continue from their
acknowledgements, as after a crash. On the bus and in files a journal is a line of text followed by
MessagePack; it contains data only, no code.
"""

import hashlib
import os
import platform
import struct
import zlib
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Literal

import msgspec
from msgspec import Struct
from msgspec.structs import replace

from groundlink.core.atomic_file import write_atomically
from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.core.fields import Quaternion, Vector3
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.control import Remove, WorldChange
from groundlink.messages.base import Ack, Command, State, WheelCommand, encode
from groundlink.messages.navigation import JointState
from groundlink.scenario import Scenario
from groundlink.scenario.decoding import put_unknown, take_unknown
from groundlink.world.actors import EntityDescription

VERSION = 1

_FIRST_LINE = b"groundlink journal "
_FIRST_LINE_BYTES = 128
"""Upper limit of its length."""

PART_BYTES = 2**20
"""Bytes of a journal in one reply on the bus; larger replies would delay states."""

BLOCK_ENTRIES = 1024
"""Entries that are compressed together."""

MAX_BLOCK_BYTES = 1 << 28
"""Limit of an uncompressed block, against malicious files. A scenario has a few megabytes."""

_LENGTH = struct.Struct("<I")


class Entry(Struct, frozen=True, array_like=True, tag=True):
    """An input of physics between two steps."""

    tick: int
    """Tick of the newest state at that time."""


class Commanded(Entry, frozen=True, tag="command"):
    """A velocity command of a vehicle."""

    vehicle: str
    command: Command
    """The stamp is sim time, without the epoch."""


class WheelsCommanded(Entry, frozen=True, tag="wheels"):
    """A command of single wheels."""

    vehicle: str
    command: WheelCommand
    """Stamp as in `Commanded`."""


class JointsCommanded(Entry, frozen=True, tag="joints"):
    """A command of joints."""

    vehicle: str
    command: JointState
    """Stamp as in `Commanded`."""


class WorldChanged(Entry, frozen=True, tag="world"):
    """Objects that were added to the world, removed or moved."""

    change: WorldChange


class Placed(Entry, frozen=True, tag="placed"):
    """A pose or velocity that was set, of a vehicle or a free actor."""

    name: str
    pose: tuple[Vector3, Quaternion] | None
    """World from its frame; None: unchanged."""

    twist: tuple[Vector3, Vector3] | None
    """Linear (m/s) and angular (rad/s) velocity of its origin, in world; None: unchanged."""


class Described(Entry, frozen=True, tag="described"):
    """Category, description and tags that tools are told of an entity."""

    name: str
    description: EntityDescription | None
    """None: what the scenario says."""


class StateReset(Entry, frozen=True, tag="state reset"):
    """All vehicles, free actors and moved solids were put back where they began."""


AnyCommanded = Commanded | WheelsCommanded | JointsCommanded

AnyEntry = AnyCommanded | WorldChanged | Placed | Described | StateReset

_ENTRY = msgspec.msgpack.Decoder(AnyEntry)

encode_entry = msgspec.msgpack.Encoder().encode
"""Return the bytes of an entry in a journal."""


class Platform(Struct, frozen=True):
    """Processor and software versions, which affect the last bits of floating-point results."""

    processor: str
    versions: dict[str, str]

    def differences(self, other: "Platform") -> str:
        """Return what differs from another platform, as text; empty if equal."""
        found = [self.processor] if self.processor != other.processor else []
        for name, version in self.versions.items():
            if version != other.versions.get(name):
                found.append(f"{name} {version}")
        return ", ".join(found)


class Journal(Struct, frozen=True, kw_only=True):
    """One episode of a run, from tick 0 or a checkpoint to a tick."""

    made_on: Platform
    run: str
    episode: int = msgspec.field(name="life")
    """See `State.episode`."""

    epoch_nanos: int
    """Stamp of sim time zero."""

    scenario: Scenario
    """Scenario at tick 0."""

    tick: int
    """Tick of the newest state. Entries that arrived later and take effect later are included."""

    digest: str
    """Digest of the state at that tick, see `state_digest`."""

    entries: tuple[bytes, ...]
    """Entries as MessagePack, in the order of arrival."""

    checkpoint: Checkpoint | msgspec.UnsetType = msgspec.UNSET
    """Where it begins, with the entries from that tick on; without one, at tick 0."""

    checkpoints: tuple[Checkpoint, ...] | msgspec.UnsetType = msgspec.UNSET
    """Further checkpoints, for a reader that asks for them."""

    left_out: int = 0
    """Number of earlier entries that are omitted because the reader has them."""

    acks: dict[str, Ack] = {}
    """Last acknowledgement of every process, by name."""

    in_loaded_world: Literal[True] | msgspec.UnsetType = msgspec.UNSET
    """Whether the world was loaded into the run, so that the scenario of its start lacks it."""

    def read(self) -> Iterator[AnyEntry]:
        """Yield the entries."""
        return map(_ENTRY.decode, self.entries)

    def remaining_scenario(self) -> Scenario:
        """Return the scenario without vehicles that were removed since tick 0."""
        changes = (entry.change for entry in self.read() if isinstance(entry, WorldChanged))
        removals = (change for change in changes if isinstance(change, Remove))
        removed = {name for change in removals for name in (change.name, *change.parts)}
        begins = self.scenario
        if self.checkpoint and self.checkpoint.scenario:
            begins = self.checkpoint.scenario
        there = {vehicle.name for vehicle in begins.vehicles} - removed
        remaining = tuple(v for v in self.scenario.vehicles if v.name in there)
        return replace(self.scenario, vehicles=remaining)

    def followed_by(self, later: "Journal") -> "Journal":
        """Return a later journal of the same episode, with its omitted entries from this one.

        Raises
        ------
        ValueError
            if it is of another episode, or this journal lacks omitted entries.
        """
        if later.episode != self.episode or later.left_out > len(self.entries):
            raise ValueError("not the continuation of this journal")
        return replace(later, entries=self.entries[: later.left_out] + later.entries, left_out=0)


def acting_before(
    tick: int, entries: Iterable[bytes]
) -> tuple[tuple[bytes, ...], tuple[bytes, ...]]:
    """Split entries into those that take effect before a tick, and the rest unchanged.

    In the first part, a command is moved to the tick of its stamp, where it takes effect, but never
    past a change of the world. So this part does not depend on when commands arrived.
    """
    placed = []
    part, limit = 0, 2**63
    for raw in reversed(tuple(entries)):
        entry = _ENTRY.decode(raw)
        if not isinstance(entry, AnyCommanded):
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


def acting_since(tick: int, entries: Iterable[bytes]) -> Iterator[AnyEntry]:
    """Yield the entries that a checkpoint at a tick lacks: those that came or act from then on."""
    for entry in map(_ENTRY.decode, entries):
        if entry.tick >= tick or _stamp_tick(entry) >= tick:
            yield replace(entry, tick=max(entry.tick, tick))


def _stamp_tick(entry: AnyEntry) -> int:
    """Return the tick of a command's stamp; -1 for another entry."""
    if isinstance(entry, AnyCommanded):
        return entry.command.stamp_nanos // TICK_NANOS
    return -1


class JournalError(UserError):
    """A journal that cannot be read."""


def state_digest(state: State) -> str:
    """Return the sha256 of a state without run name, episode and epoch."""
    plain = replace(state, run="", episode=0, epoch_nanos=0)
    return hashlib.sha256(encode(plain)).hexdigest()


@cache
def this_platform() -> Platform:
    """Return the platform of this process."""
    from importlib import metadata  # Slow to import, and needed for saved runs only.

    names = ("groundlink", "pybullet", "numpy")
    versions = {"python": platform.python_version()}
    for name in names:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return Platform(_processor(), versions)


def _processor() -> str:
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            name, _, value = line.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.machine()


def dumped(journal: Journal) -> bytes:
    """Return a journal as the bytes of a file.

    The journal of an hour takes 0.2 s. Blocks keep other threads responsive.
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
    """Return the journal in `content`; `where` names it in errors.

    Raises
    ------
    JournalError
        if it is no journal, damaged, or of another version.
    """
    line, newline, _ = content[:_FIRST_LINE_BYTES].partition(b"\n")
    words = line.removeprefix(_FIRST_LINE).split()
    if not line.startswith(_FIRST_LINE) or not newline or len(words) != 2 or not words[0].isdigit():
        raise JournalError(f"{where}: not a saved run; expected a file of `groundlink save`")
    if int(words[0]) != VERSION:
        raise JournalError(
            f"{where}: unsupported format; expected {VERSION}, got {int(words[0])}. Fix: restore "
            "it with the version of Groundlink that saved it"
        )
    body = memoryview(content)[len(line) + 1 :]
    if hashlib.sha256(body).hexdigest().encode() != words[1]:
        raise JournalError(f"{where}: truncated or damaged. Fix: copy or save the run again")
    try:
        blocks = _blocks(body)
        head = _head(next(blocks))
        more = (msgspec.msgpack.decode(block, type=tuple[bytes, ...]) for block in blocks)
        journal = replace(head, entries=tuple(entry for part in more for entry in part))
        for _ in journal.read():
            pass
    except (msgspec.DecodeError, zlib.error, struct.error, StopIteration) as error:
        raise JournalError(
            f"{where}: the scenario does not match this version of Groundlink ({error}). Fix: "
            "restore it with the version that saved it"
        ) from None
    return journal


def _head(block: bytes) -> Journal:
    """Return a journal without its further blocks; sensors of unknown kinds are kept."""
    try:
        return msgspec.msgpack.decode(block, type=Journal)
    except msgspec.ValidationError:
        plain = msgspec.msgpack.decode(block)
        unknown = take_unknown(plain.get("scenario") if isinstance(plain, dict) else None)
        head = msgspec.convert(plain, Journal)
        return replace(head, scenario=put_unknown(head.scenario, unknown))


def _blocks(body: memoryview) -> Iterator[bytes]:
    at = 0
    while at < len(body):
        (size,) = _LENGTH.unpack_from(body, at)
        at += _LENGTH.size + size
        yield zlib.decompressobj().decompress(body[at - size : at], MAX_BLOCK_BYTES)


def write(path: Path, content: bytes) -> None:
    """Write a file atomically, replacing an existing one.

    Raises
    ------
    UserError
        if it cannot be written.
    """
    with write_atomically(path) as part, part.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def read(path: Path) -> bytes:
    """Return the content of a file.

    Raises
    ------
    JournalError
        if it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise JournalError(
            f"cannot read {path}: {(error.strerror or str(error)).lower()}"
        ) from None


def is_saved_run(path: Path) -> bool:
    """Return whether a file starts like a saved run; False if it cannot be read."""
    with suppress(OSError), path.open("rb") as file:
        return file.read(len(_FIRST_LINE)) == _FIRST_LINE
    return False


def parts(content: bytes) -> list[bytes]:
    """Split the bytes of a journal into replies to one query."""
    return [content[i : i + PART_BYTES] for i in range(0, len(content), PART_BYTES)]
