# SPDX-License-Identifier: Apache-2.0
"""The journal of an instant has the checkpoint that serves it, and what came since."""

from collections.abc import Iterator
from math import nan
from pathlib import Path

import pytest

from groundlink.core.clock import TICK_NANOS
from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint, dumped
from groundlink.episode.journal import (
    AnyEntry,
    Commanded,
    Described,
    Journal,
    encode_entry,
    this_platform,
)
from groundlink.episode.journal import dumped as dump_journal
from groundlink.loader import load
from groundlink.messages.base import Ack, Command
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile
from groundlink.recording.seeking import journal_at

EPOCH = 10**18
STILL = (0.0, 0.0, 0.0)
SCENARIO = load("indoor_lab")
LAST_TICK = 4000


def commanded(tick: int, stamp_tick: int, vehicle: str = "rover") -> Commanded:
    return Commanded(tick, vehicle, Command(stamp_tick * TICK_NANOS, STILL, STILL))


ENTRIES: tuple[tuple[AnyEntry, ...], ...] = (
    # Parts of the journal, of 800 ticks each.
    (commanded(0, 0), commanded(790, 1010)),
    (Described(800, "rover", None), commanded(1000, 1000), commanded(1190, 1190)),
    (commanded(1640, 1640), commanded(1648, 1648, "other"), commanded(1656, 1656)),
    (Described(2500, "rover", None),),
)

CHECKPOINTS = (
    Checkpoint(tick=800, memory=b"a", acks={"rover/imu": Ack(0, 900, 800)}),
    Checkpoint(
        tick=1600,
        memory=b"b",
        acks={
            "rover/imu": Ack(0, 1604, 1600),
            "rover/driver": Ack(0, 1632, 1632, b"", {"rover": 1640}),
        },
    ),
)


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[Recording]:
    yield from opened(tmp_path / "run.mcap", CHECKPOINTS)


def opened(path: Path, checkpoints: tuple[Checkpoint, ...]) -> Iterator[Recording]:
    file = RosFile(path)
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(SCENARIO, "lab", EPOCH)))
    topic = file.topic("/clock", "rosgraph_msgs/msg/Clock")
    for tick in (0, LAST_TICK):
        topic.write(EPOCH + tick * TICK_NANOS, memoryview(bytes(12)))
    left_out = 0
    for number, entries in enumerate(ENTRIES, 1):
        part = Journal(
            made_on=this_platform(),
            run="lab",
            episode=0,
            epoch_nanos=EPOCH,
            scenario=SCENARIO,
            tick=800 * number,
            digest="",
            entries=tuple(map(encode_entry, entries)),
            left_out=left_out,
        )
        left_out += len(entries)
        file.add_journal(EPOCH + (800 * number - 5) * TICK_NANOS, dump_journal(part))
    for checkpoint in checkpoints:
        file.add_checkpoint(EPOCH + checkpoint.tick * TICK_NANOS, dumped(checkpoint))
    file.mcap.commit("topics", {})
    file.close()
    with Recording(path) as found:
        yield found


@pytest.mark.parametrize(
    ("tick", "begins_at", "entries"),
    [
        # The first command of 1010 came before the checkpoint and acts after it.
        (1010, 800, [commanded(800, 1010), *ENTRIES[1][:2]]),
        (1200, 800, [commanded(800, 1010), *ENTRIES[1]]),
        # The IMU has acknowledged 1604 only: a run at 1602 cannot continue from there.
        (1602, 800, [commanded(800, 1010), *ENTRIES[1]]),
        # The driver had sent its command of 1640 by 1632, but no later one.
        (1632, 1600, [commanded(1632, 1640)]),
        (1650, 1600, ENTRIES[2][:2]),
        (4000, 1600, [*ENTRIES[2], *ENTRIES[3]]),
    ],
)
def test_entries_since_the_checkpoint(
    recording: Recording, tick: int, begins_at: int, entries: list[AnyEntry]
) -> None:
    journal = journal_at(recording, tick / 400)
    [checkpoint] = [c for c in CHECKPOINTS if c.tick == begins_at]
    assert (journal.tick, journal.checkpoint, journal.acks) == (tick, checkpoint, checkpoint.acks)
    assert [*journal.read()] == [*entries]


@pytest.mark.parametrize("tick", [0, 500, 850])
def test_before_the_first_checkpoint_all_begins_at_tick_0(recording: Recording, tick: int) -> None:
    journal = journal_at(recording, tick / 400)
    assert not journal.checkpoint
    assert journal.acks == {"rover/imu": Ack(0, -1, -1)}
    assert [entry.tick for entry in journal.read()] == [
        entry.tick for part in ENTRIES for entry in part if entry.tick < tick
    ]


@pytest.mark.parametrize("seconds", [-1.0, 10.01, nan])
def test_outside_of_the_recording(recording: Recording, seconds: float) -> None:
    with pytest.raises(UserError, match=r"outside of .*run.mcap; expected .* from 0 to 10"):
        journal_at(recording, seconds)


def test_without_checkpoints(tmp_path: Path) -> None:
    for recording in opened(tmp_path / "run.mcap", ()):
        with pytest.raises(UserError, match=r"no checkpoints\. Fix: record it with"):
            journal_at(recording, 1.0)


def test_damaged_checkpoint(tmp_path: Path) -> None:
    for recording in opened(tmp_path / "run.mcap", CHECKPOINTS):
        content = dumped(CHECKPOINTS[1])
        whole = bytearray((tmp_path / "run.mcap").read_bytes())
        at = whole.index(content)
        whole[at + 2 : at + len(content)] = bytes(len(content) - 2)
        (tmp_path / "damaged.mcap").write_bytes(whole)
        with (
            Recording(tmp_path / "damaged.mcap") as damaged,
            pytest.raises(UserError, match=r"damaged.mcap: a checkpoint is damaged"),
        ):
            journal_at(damaged, 9.0)
        assert recording.checkpoints
