# SPDX-License-Identifier: Apache-2.0
"""Checkpoint: a tick of an episode from which it can be continued without the ticks before.

At a checkpoint a run rebuilds all that moves from the checkpoint's own data. So a run that
continues from it takes the same steps as the run that made it, to the bit.
"""

import zlib

import msgspec
from msgspec import UNSET, Struct, UnsetType
from msgspec.structs import replace

from groundlink.core.clock import TICK_RATE_HZ
from groundlink.core.errors import UserError
from groundlink.messages.base import Ack
from groundlink.scenario import Scenario

MAX_BYTES = 1 << 28
"""Limit of an uncompressed checkpoint, against malicious files."""


class Checkpoint(Struct, frozen=True, kw_only=True):
    """What an episode is continued from: a world at a tick, and processes after it."""

    tick: int
    """Tick of the state that is published next."""

    scenario: Scenario | UnsetType = UNSET
    """Scenario of the present world, where the world was changed since tick 0."""

    memory: bytes
    """Inner state of physics. Its format is private to physics."""

    acks: dict[str, Ack] = {}
    """By process, its first acknowledgement that is settled up to this tick or later."""

    @property
    def serves_from_tick(self) -> int:
        """First tick at which all processes can continue from their acknowledgements."""
        return max((ack.tick for ack in self.acks.values()), default=self.tick)

    def of_episode(self, number: int) -> "Checkpoint":
        """Return the checkpoint with acknowledgements of another episode, sorted by name."""
        acks = {name: replace(ack, episode=number) for name, ack in sorted(self.acks.items())}
        return replace(self, acks=acks)


def period_ticks(seconds: float) -> int:
    """Return the period of checkpoints in ticks."""
    return round(seconds * TICK_RATE_HZ)


def dumped(checkpoint: Checkpoint) -> bytes:
    """Return a checkpoint as the bytes of an attachment of a recording."""
    return zlib.compress(msgspec.msgpack.encode(checkpoint))


def loaded(content: bytes, where: str) -> Checkpoint:
    """Return the checkpoint in `content`; `where` names it in errors.

    Raises
    ------
    UserError
        when it is damaged or of another version.
    """
    try:
        plain = zlib.decompressobj().decompress(content, MAX_BYTES)
        return msgspec.msgpack.decode(plain, type=Checkpoint)
    except (zlib.error, msgspec.DecodeError) as error:
        raise UserError(
            f"{where}: a checkpoint is damaged or of another version of Groundlink ({error}). Fix: "
            "use the version that recorded it, or record the run again"
        ) from None
