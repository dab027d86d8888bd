# SPDX-License-Identifier: Apache-2.0
"""The file is whole after every commit, whatever ends its writer."""

import errno
import io
import itertools
import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, ChunkIndex, Footer, Statistics
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Reader

from groundlink.recording import mcap_file
from groundlink.recording.mcap_file import McapFile
from groundlink.recording.ros_channels import LATCHED_QOS, RosFile

Row = tuple[str, int, bytes]


def summary_of(path: Path) -> tuple[list[ChunkIndex], Statistics]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    return summary.chunk_indexes, summary.statistics


def rows(path: Path) -> list[Row]:
    """Return what the indexed reader finds, checksums checked."""
    _, statistics = summary_of(path)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        found = [(c.topic, m.log_time, m.data) for _, c, m in reader.iter_messages()]
        assert statistics.message_count == len(found)
        assert sum(statistics.channel_message_counts.values()) == len(found)
        assert statistics.metadata_count == len(list(reader.iter_metadata()))
        return found


@pytest.fixture
def file(tmp_path: Path) -> McapFile:
    it = McapFile(tmp_path / "a.mcap", profile="ros2", library="test")
    for topic in ("/a", "/b"):
        it.add_channel(topic, it.add_schema(f"pkg/msg{topic}", "ros2msg", b""), "cdr", {})
    return it


def write(file: McapFile, begin: int, end: int) -> list[Row]:
    """Write messages of two topics whose times interleave; return them in the order of time."""
    written = []
    for i in range(begin, end):
        for channel in (1, 2):
            body = bytes([i % 256, channel]) * (i % 7 * 100)
            file.write(channel, 10 * i + 5 * channel, i, body)
            written.append((f"/{' ab'[channel]}", 10 * i + 5 * channel, body))
    return sorted(written, key=lambda row: row[1])


def test_file_is_complete_after_every_commit(file: McapFile, tmp_path: Path) -> None:
    path, written = tmp_path / "a.mcap", []
    file.commit("topics", {"round": "none"})
    assert rows(path) == []
    for begin in range(0, 50, 10):
        written += write(file, begin, begin + 10)
        file.commit("topics", {"round": str(begin)})
        assert rows(path) == written
        assert path.stat().st_size == file.size_bytes
        with path.open("rb") as stream:
            found = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
        assert found == {"topics": {"round": str(begin)}}
    file.close()


def test_a_stream_reader_finds_the_same(file: McapFile, tmp_path: Path) -> None:
    """Without its index the file is read from the front, as `mcap recover` does."""
    written = write(file, 0, 20)
    file.commit("topics", {})
    file.close()
    stream = io.BytesIO((tmp_path / "a.mcap").read_bytes())
    found = NonSeekingReader(stream, validate_crcs=True).iter_messages()
    assert [(c.topic, m.log_time, m.data) for _, c, m in found] == written


def test_full_chunks_are_closed_by_themselves(
    file: McapFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap_file, "CHUNK_BYTES", 3000)
    written = write(file, 0, 40)
    file.commit("topics", {})
    assert rows(tmp_path / "a.mcap") == written
    assert len(summary_of(tmp_path / "a.mcap")[0]) > 5


def test_what_exists_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("mine")
    with pytest.raises(FileExistsError):
        McapFile(path, profile="", library="")
    assert path.read_text() == "mine"


Pwritev = Callable[[int, list[Any], int], int]


def failing_after(count: int, real: Pwritev) -> Pwritev:
    """Return a stand-in of pwritev that finds the disk full after some bytes, once."""
    left = [count]

    def pwritev(file: int, parts: list[Any], place: int) -> int:
        if left[0] < 0:
            return real(file, parts, place)
        room = b"".join(parts)[: left[0]]
        left[0] -= len(room)
        if not room:
            left[0] = -1
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(file, [room], place)

    return pwritev


@pytest.mark.parametrize("room", [0, 1, 100, 500, 5000, 10_500])
def test_a_full_disk_leaves_the_file_as_it_was(
    file: McapFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    written = write(file, 0, 10)
    file.commit("topics", {})
    before = (tmp_path / "a.mcap").read_bytes()
    for i in range(10):
        file.write(1, 1000 + i, i, os.urandom(1000))
    monkeypatch.setattr(os, "pwritev", failing_after(room, os.pwritev))
    with pytest.raises(OSError, match="No space left"):
        file.commit("topics", {})
    assert (tmp_path / "a.mcap").read_bytes() == before
    assert rows(tmp_path / "a.mcap") == written


class Killed(BaseException):
    pass


@pytest.mark.parametrize(
    ("call", "share"), [(1, 0.0), (1, 1.0), *((2, i / 10) for i in range(11)), (3, 0.0), (3, 1.0)]
)
def test_kill_during_a_write_leaves_a_complete_file(
    file: McapFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: int, share: float
) -> None:
    """Killed in one of a commit's three writes: of tail, chunks, tail."""
    written = write(file, 0, 10)
    file.commit("topics", {})
    later = write(file, 10, 20)
    real, calls = os.pwritev, []

    def pwritev(descriptor: int, parts: list[Any], place: int) -> int:
        calls.append(place)
        if len(calls) == call:
            data = b"".join(parts)
            real(descriptor, [data[: int(share * len(data))]], place)
            raise Killed
        return real(descriptor, parts, place)

    monkeypatch.setattr(os, "pwritev", pwritev)
    with pytest.raises(Killed):
        file.commit("topics", {})
    is_done = (call, share) == (3, 1.0)
    assert rows(tmp_path / "a.mcap") == written + (later if is_done else [])


def test_a_torn_tail_loses_no_chunk(file: McapFile, tmp_path: Path) -> None:
    """What is lacking then is the index; `mcap recover` reads from the front, as is done here."""
    written = write(file, 0, 10)
    file.commit("topics", {})
    whole = (tmp_path / "a.mcap").read_bytes()
    stream = io.BytesIO(whole[:-100])
    messages = NonSeekingReader(stream).iter_messages(log_time_order=False)
    found = [(c.topic, m.log_time, m.data) for _, c, m in itertools.islice(messages, len(written))]
    assert sorted(found, key=lambda row: row[1]) == written
    with pytest.raises(struct.error):
        next(messages)


def test_rosbags_reads_policies_and_definitions(tmp_path: Path) -> None:
    file = RosFile(tmp_path / "a.mcap")
    topic = file.topic("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
    file.topic("/imu", "sensor_msgs/msg/Imu")
    topic.write(5, memoryview(bytes(8)))
    file.mcap.commit("topics", {})
    file.mcap.close()
    with Reader(tmp_path / "a.mcap") as reader:
        by_topic = {c.topic: c for c in reader.connections}
    latched = by_topic["/tf_static"].ext.offered_qos_profiles[0]  # type: ignore[union-attr]
    plain = by_topic["/imu"].ext.offered_qos_profiles[0]  # type: ignore[union-attr]
    assert (latched.durability.name, latched.depth) == ("TRANSIENT_LOCAL", 1)
    assert (plain.durability.name, plain.reliability.name) == ("VOLATILE", "RELIABLE")
    assert "MSG: std_msgs/Header" in by_topic["/imu"].msgdef.data
    assert "durability: 1" in LATCHED_QOS  # a number: Humble reads no words


def test_times_of_a_topic_never_decrease(tmp_path: Path) -> None:
    file = RosFile(tmp_path / "a.mcap")
    topic = file.topic("/tf", "tf2_msgs/msg/TFMessage")
    for nanos in (5, 3, 8):
        topic.write(nanos, memoryview(np.zeros(8, np.uint8)))
    file.mcap.commit("topics", {})
    assert [nanos for _, nanos, _ in rows(tmp_path / "a.mcap")] == [5, 5, 8]


def test_attachments_are_found_by_all_readers(file: McapFile, tmp_path: Path) -> None:
    first = write(file, 0, 10)
    file.add_attachment("notes", "text/plain", 7, b"one")
    file.commit("topics", {})
    later = write(file, 10, 20)
    file.add_attachment("notes", "text/plain", 8, b"two")
    file.commit("topics", {})
    file.close()
    path = tmp_path / "a.mcap"
    assert rows(path) == first + later
    assert summary_of(path)[1].attachment_count == 2
    with path.open("rb") as stream:
        found = [(a.name, a.log_time, a.data) for a in make_reader(stream).iter_attachments()]
    assert found == [("notes", 7, b"one"), ("notes", 8, b"two")]
    with path.open("rb") as stream:
        plain = NonSeekingReader(stream, validate_crcs=True)
        assert [a.data for a in plain.iter_attachments()] == [b"one", b"two"]
    with Reader(path) as rosbag:
        assert rosbag.message_count == len(first + later)


def test_a_chunk_and_its_index_say_when_it_begins_and_ends(file: McapFile, tmp_path: Path) -> None:
    expected = []
    for part in range(3):
        times = [row[1] for row in write(file, 50 * part, 50 * part + 50)]
        expected.append((min(times), max(times)))
        file.close_chunk()
    file.commit("end", {})
    indexes, statistics = summary_of(tmp_path / "a.mcap")
    assert [(i.message_start_time, i.message_end_time) for i in indexes] == expected
    with (tmp_path / "a.mcap").open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        chunks = [record for record in records if isinstance(record, Chunk)]
    assert [(chunk.message_start_time, chunk.message_end_time) for chunk in chunks] == expected
    assert statistics.message_start_time == expected[0][0]
    assert statistics.message_end_time == expected[-1][1]


def test_chunks_and_summary_have_checksums(file: McapFile, tmp_path: Path) -> None:
    """A checksum of 0 stands for none, so a reader that checks them accepts it."""
    write(file, 0, 50)
    file.commit("end", {})
    content = (tmp_path / "a.mcap").read_bytes()
    records = [*StreamReader(io.BytesIO(content), emit_chunks=True).records]
    (chunk,) = (record for record in records if isinstance(record, Chunk))
    plain = zstandard.ZstdDecompressor().decompress(chunk.data, chunk.uncompressed_size)
    assert chunk.uncompressed_crc == zlib.crc32(plain) != 0
    (footer,) = (record for record in records if isinstance(record, Footer))
    summary = content[footer.summary_start : -len(mcap_file.MAGIC) - 4]
    assert footer.summary_crc == zlib.crc32(summary) != 0
