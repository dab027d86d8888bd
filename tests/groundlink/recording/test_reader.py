# SPDX-License-Identifier: Apache-2.0
"""What is no recording becomes one line for its user."""

from pathlib import Path

import pytest
from mcap.writer import Writer

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.recording.metadata import RUN_RECORD, describe_run, run_entries, run_facts
from groundlink.recording.reader import Recording
from groundlink.recording.ros_channels import RosFile


def recording(path: Path, messages: int = 50) -> bytes:
    file = RosFile(path)
    scenario = load("indoor_lab")
    file.mcap.add_metadata(RUN_RECORD, run_entries(describe_run(scenario, "lab", 3)))
    topic = file.topic("/clock", "rosgraph_msgs/msg/Clock")
    for i in range(messages):
        topic.write(i + 1, memoryview(bytes(12)))
    file.mcap.commit("topics", {})
    file.mcap.close()
    return path.read_bytes()


def test_a_run_s_facts_survive_being_text() -> None:
    before = describe_run(load("indoor_lab"), "lab", 1_700_000_000_123_456_789)
    assert run_facts(run_entries(before)) == before
    assert before.versions["groundlink"]
    assert len(before.world_hash) > 12


def test_an_mcap_file_of_others(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()  # type: ignore[no-untyped-call]
        writer.finish()  # type: ignore[no-untyped-call]
    with pytest.raises(UserError, match="an MCAP file without a run"):
        Recording(tmp_path / "a.mcap")


def test_one_without_its_end_says_what_mends_it(tmp_path: Path) -> None:
    whole = recording(tmp_path / "a.mcap")
    for cut in range(10, len(whole), 50):
        (tmp_path / "b.mcap").write_bytes(whole[:cut])
        with pytest.raises(UserError, match="mcap recover"):
            Recording(tmp_path / "b.mcap")


def test_damaged_chunk_is_reported_when_read(tmp_path: Path) -> None:
    whole = bytearray(recording(tmp_path / "a.mcap", 5000))
    begin = whole.index(b"zstd") + 12
    whole[begin : begin + 400] = bytes(400)
    (tmp_path / "b.mcap").write_bytes(whole)
    with Recording(tmp_path / "b.mcap") as damaged, pytest.raises(UserError, match="damaged"):
        list(damaged.read())


def test_chunks_that_overlap_are_read_in_order_of_time(tmp_path: Path) -> None:
    file = RosFile(tmp_path / "a.mcap")
    run = describe_run(load("indoor_lab"), "lab", 3)
    file.mcap.add_metadata(RUN_RECORD, run_entries(run))
    one, other = (file.topic(name, "rosgraph_msgs/msg/Clock") for name in ("/one", "/other"))
    for topic, times in ((one, (1, 4, 9)), (other, (2, 4, 5)), (one, (10, 12)), (other, (11,))):
        for nanos in times:
            topic.write(nanos, memoryview(bytes([nanos])))
        file.mcap.close_chunk()
    file.commit({})
    file.close()
    with Recording(tmp_path / "a.mcap") as recording:
        assert all(each.cdr == bytes([each.nanos]) for each in recording.read())
        found = [(each.nanos, each.topic) for each in recording.read()]
        assert found == [
            *((1, "/one"), (2, "/other"), (4, "/one"), (4, "/other"), (5, "/other")),
            *((9, "/one"), (10, "/one"), (11, "/other"), (12, "/one")),
        ]
        assert [(e.nanos, e.topic) for e in recording.read(["/other"])] == [
            each for each in found if each[1] == "/other"
        ]
        assert [(e.nanos, e.topic) for e in recording.read(from_nanos=5)] == found[4:]
        assert list(recording.read(["/absent"])) == []
