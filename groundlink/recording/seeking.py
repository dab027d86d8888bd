# SPDX-License-Identifier: Apache-2.0
"""Journal of one instant of a recorded run: from the checkpoint before it, and what came since.

Only the parts of the file that belong to that time are read, so the length of a recording does not
matter.
"""

from bisect import bisect_left, bisect_right
from collections.abc import Iterator

from msgspec.structs import replace

from groundlink.core.clock import NANOS, TICK_NANOS, TICK_RATE_HZ, TICK_SECONDS
from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.journal import AnyCommanded, AnyEntry, Journal, acting_since, encode_entry
from groundlink.messages.base import Ack

from .reader import Recording

LATE_NANOS = 4 * NANOS
"""A journal entry is in the file at most this long after the tick at which it acts."""


def journal_at(recording: Recording, seconds: float) -> Journal:
    """Return the journal that leads to an instant of a recorded run.

    Of later commands it has those that had been sent by then. Restored, the run continues as the
    recorded one did, but for commands from elsewhere, such as ROS.

    Parameters
    ----------
    seconds
        sim time, from the start of the run.

    Raises
    ------
    UserError
        when it is outside of the recording, or the recording has no checkpoint before it.
    """
    epoch_nanos = recording.run.epoch_nanos
    last_tick = (recording.last_nanos - epoch_nanos) // TICK_NANOS
    if not 0 <= seconds <= last_tick * TICK_SECONDS:
        raise UserError(
            f"--at {seconds:g}: outside of {recording.path}; expected seconds of sim time from "
            f"0 to {last_tick * TICK_SECONDS:g}"
        )
    tick = round(seconds * TICK_RATE_HZ)
    checkpoint, acks = _checkpoint_before(recording, tick)
    begin_nanos = epoch_nanos + (checkpoint.tick if checkpoint else 0) * TICK_NANOS
    until_nanos = epoch_nanos + tick * TICK_NANOS + LATE_NANOS
    known = recording.journal_parts
    # The part before has commands that act later.
    first = bisect_left(known, begin_nanos, key=lambda part: part.nanos)
    last = bisect_right(known, until_nanos, key=lambda part: part.nanos)
    parts = [part.load() for part in known[max(first - 1, 0) : last + 1]]
    if not parts:
        raise UserError(f"{recording.path}: no journal of that time. Fix: record the run again")
    entries = (e for part in parts for e in _sent_before(tick, part, checkpoint))
    return replace(
        parts[0],
        episode=0,
        tick=tick,
        digest="",
        entries=tuple(map(encode_entry, entries)),
        left_out=0,
        acks=acks,
        checkpoint=checkpoint or parts[0].checkpoint,
    )


def _checkpoint_before(recording: Recording, tick: int) -> tuple[Checkpoint | None, dict[str, Ack]]:
    """Return the last checkpoint that serves a tick, and the acknowledgements to continue from.

    None stands for the start of the journal, from which all processes repeat what they did.

    Raises
    ------
    UserError
        when there is no checkpoint in the recording.
    """
    known = recording.checkpoints
    if not known:
        raise UserError(
            f"{recording.path}: no checkpoints. Fix: record it with `groundlink record "
            "--checkpoints 5`, or set `time.checkpoint_s` in its scenario"
        )
    instant = recording.run.epoch_nanos + tick * TICK_NANOS
    for attached in reversed(known):
        if attached.nanos <= instant and (found := attached.load()).serves_from_tick <= tick:
            return found, found.acks
    return None, dict.fromkeys(known[0].load().acks, Ack(0, -1, -1))


def _sent_before(tick: int, journal: Journal, checkpoint: Checkpoint | None) -> Iterator[AnyEntry]:
    """Yield the entries since a checkpoint that had been made before a tick.

    A driver has sent commands that act later; its acknowledgement tells which.
    """
    sent: dict[str, int] = {}
    for ack in checkpoint.acks.values() if checkpoint else ():
        sent |= {vehicle: max(at, sent.get(vehicle, at)) for vehicle, at in ack.commanded.items()}
    for entry in acting_since(checkpoint.tick if checkpoint else 0, journal.entries):
        if entry.tick < tick:
            yield entry
        elif isinstance(entry, AnyCommanded) and (
            entry.command.stamp_nanos // TICK_NANOS <= sent.get(entry.vehicle, -1)
        ):
            yield replace(entry, tick=tick)
