# SPDX-License-Identifier: Apache-2.0
"""What was saved is what is read, and all else is told in one line."""

import hashlib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.episode import journal as module
from groundlink.episode.control import Move, Remove, Spawn
from groundlink.episode.journal import (
    BLOCK_ENTRIES,
    AnyEntry,
    Commanded,
    Described,
    JointsCommanded,
    Journal,
    JournalError,
    Placed,
    Platform,
    StateReset,
    WheelsCommanded,
    WorldChanged,
    acting_before,
    dumped,
    encode_entry,
    is_saved_run,
    loaded,
    parts,
    read,
    state_digest,
    this_platform,
    write,
)
from groundlink.loader import load
from groundlink.loader.additions import KINDS
from groundlink.messages.base import Ack, Command, State, WheelCommand, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario.every_sensor import UnknownSensor
from groundlink.world.actors import EntityDescription

SCENARIO = load(str(Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml"))

POSE = (1.0, 2.0, 0.5), (0.0, 0.0, 0.6, 0.8)

ENTRIES = (
    Commanded(0, "rover", Command(2_500_000, (0.5, 0.0, 0.0), (0.0, 0.0, -0.25))),
    WheelsCommanded(3, "rover", WheelCommand(7_500_000, {"wheel": 1.5}, {"fork": 0.1})),
    JointsCommanded(
        4, "tank", JointState(10_000_000, "", ("gun",), *3 * (packed(np.array([0.1])),))
    ),
    WorldChanged(3, Spawn(KINDS["person"])),
    WorldChanged(9, Remove("person")),
    WorldChanged(9, Remove("kit", ("kit_a", "kit_b"))),
    WorldChanged(9, Move("kit", *POSE, {"kit_a": POSE})),
    Placed(10, "rover", POSE, None),
    Placed(10, "rover", None, ((0.5, 0.0, 0.0), (0.0, 0.0, 0.1))),
    Described(11, "rover", EntityDescription(category="robot", tags=("ego",))),
    Described(11, "rover", None),
    StateReset(12),
)

SAVED = Journal(
    made_on=this_platform(),
    run="run",
    episode=7,
    epoch_nanos=10**18,
    scenario=SCENARIO,
    tick=40,
    digest="0" * 64,
    entries=tuple(map(encode_entry, ENTRIES)),
    acks={"rover/imu": Ack(7, 39, 30, b"memory", {"rover": 48})},
)


def test_saved_journal_is_read_back() -> None:
    found = loaded(dumped(SAVED), "file")
    assert found == SAVED
    assert tuple(found.read()) == ENTRIES


def test_sensor_of_a_kind_that_is_not_installed_is_kept() -> None:
    fields = {"kind": "sonar", "name": "sonar", "topic": "/sonar", "frame": "sonar_link"}
    (rover,) = SCENARIO.vehicles
    unknown = msgspec.convert({**fields, "kind": "unknown", "fields": fields}, UnknownSensor)
    rover = replace(rover, sensors=(unknown, *rover.sensors))
    saved = replace(SAVED, scenario=replace(SCENARIO, vehicles=(rover,)))
    assert loaded(dumped(saved), "file") == saved


@pytest.mark.parametrize("count", [0, 1, BLOCK_ENTRIES, 3 * BLOCK_ENTRIES + 1])
def test_any_number_of_entries_is_kept_in_order(count: int) -> None:
    entries = tuple(encode_entry(WorldChanged(i, Remove("x"))) for i in range(count))
    assert loaded(dumped(replace(SAVED, entries=entries)), "file").entries == entries


def test_journal_is_sent_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PART_BYTES", 100)
    content = dumped(SAVED)
    assert b"".join(parts(content)) == content
    assert max(map(len, parts(content))) == 100


def test_a_journal_goes_on_where_an_earlier_one_ends() -> None:
    first = replace(SAVED, tick=5, entries=SAVED.entries[:3])
    rest = replace(SAVED, entries=SAVED.entries[3:], left_out=3)
    assert first.followed_by(rest) == SAVED
    for other in (replace(rest, episode=8), replace(rest, left_out=4)):
        with pytest.raises(ValueError, match="continuation"):
            first.followed_by(other)


def foreign(version: int, body: bytes) -> bytes:
    digest = hashlib.sha256(body).hexdigest()
    return f"groundlink journal {version} {digest}\n".encode() + body


GOOD = dumped(SAVED)
BODY = GOOD[GOOD.index(b"\n") + 1 :]

WRONG = {
    "empty": (b"", "file: not a saved run; expected a file of `groundlink save`"),
    "foreign": (b"name: lab\nworld: x\n", "not a saved run"),
    "binary": (bytes(range(256)), "not a saved run"),
    "first line alone": (GOOD[:19], "not a saved run"),
    "cut off": (GOOD[:-1], "truncated or damaged"),
    "longer": (GOOD + b"x", "truncated or damaged"),
    "damaged": (GOOD[:-9] + b"x" + GOOD[-8:], "truncated or damaged"),
    "newer": (
        foreign(2, BODY),
        "file: unsupported format; expected 1, got 2. Fix: restore it with the version of "
        "Groundlink that saved it",
    ),
    "no blocks": (foreign(1, b""), "the scenario does not match this version"),
    "half a length": (foreign(1, b"\0"), "the scenario does not match this version"),
    "not compressed": (foreign(1, b"\1\0\0\0x"), "the scenario does not match this version"),
    "other entries": (
        dumped(replace(SAVED, entries=(b"\x93\xa4warp\0\0",))),
        "the scenario does not match this version",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_other_files_give_one_line(name: str) -> None:
    content, told = WRONG[name]
    with pytest.raises(JournalError) as caught:
        loaded(content, "file")
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_file_is_written_atomically(tmp_path: Path) -> None:
    file = tmp_path / "a.run"
    write(file, GOOD)
    write(file, GOOD + b"more")
    assert read(file) == GOOD + b"more"
    assert list(tmp_path.iterdir()) == [file]
    assert is_saved_run(file)


def test_unusable_file_gives_one_line(tmp_path: Path) -> None:
    nowhere = tmp_path / "none" / "a.run"
    with pytest.raises(UserError, match=r"cannot write .*: no such file or directory"):
        write(nowhere, GOOD)
    with pytest.raises(JournalError, match=r"cannot read .*: no such file or directory"):
        read(nowhere)
    with pytest.raises(UserError, match="is a directory"):
        write(tmp_path, GOOD)
    assert list(tmp_path.iterdir()) == []
    assert not is_saved_run(nowhere)
    assert not is_saved_run(tmp_path)


def test_platform_differences_are_listed() -> None:
    here, there = Platform("one", {"a": "1", "b": "2"}), Platform("two", {"a": "1", "b": "3"})
    assert here.differences(here) == ""
    assert here.differences(there) == "one, b 2"
    assert this_platform().versions.keys() >= {"python", "pybullet", "numpy"}


def test_a_state_has_one_digest_in_every_episode() -> None:
    state = State("run", 1, 5, 3, 7_500_000, "hash", {})
    assert state_digest(state) == state_digest(replace(state, run="b", episode=2, epoch_nanos=6))
    assert state_digest(state) != state_digest(replace(state, tick=4))


def test_removed_vehicle_is_absent() -> None:
    assert SAVED.remaining_scenario() == SCENARIO
    gone = encode_entry(WorldChanged(12, Remove("rover")))
    assert replace(SAVED, entries=(gone,)).remaining_scenario().vehicles == ()


def test_effective_commands_do_not_depend_on_arrival() -> None:
    def commanded(came: int, acts: int, vehicle: str = "rover") -> bytes:
        command = Command(acts * 2_500_000, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        return encode_entry(Commanded(came, vehicle, command))

    came = [commanded(0, 8), commanded(0, 8, "a"), commanded(3, 16), commanded(20, 16)]
    later = [commanded(5, 8), commanded(5, 8, "a"), commanded(16, 16), commanded(20, 16)]
    earlier, rest = acting_before(20, came)
    assert earlier == (commanded(8, 8, "a"), commanded(8, 8), commanded(16, 16))
    assert rest == (commanded(20, 16),)  # as late as it came
    assert acting_before(20, reversed(later[:2]))[0] == earlier[:2]
    assert acting_before(20, later) == (earlier, rest)


@pytest.mark.parametrize(
    "change", [WorldChanged(9, Remove("rover")), Placed(9, "rover", POSE, None), StateReset(9)]
)
def test_a_command_is_not_moved_beyond_a_change(change: AnyEntry) -> None:
    command = Command(40 * 2_500_000, (1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    changed = encode_entry(change)
    entries = (encode_entry(Commanded(5, "rover", command)), changed)
    moved = encode_entry(Commanded(9, "rover", command))
    assert acting_before(10, entries) == ((moved, changed), ())
    assert acting_before(9, entries) == ((), entries)
