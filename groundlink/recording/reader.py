# SPDX-License-Identifier: Apache-2.0
"""Reader of recordings: run, topics, journal, and messages in order of time.

Memory does not grow with the file. A damaged file raises `UserError` with one line. Message bodies
stay CDR.
"""

import struct
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

import msgspec
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Attachment, Chunk, ChunkIndex
from mcap.stream_reader import StreamReader, get_chunk_data_stream
from zstandard import ZstdError

from groundlink.core.errors import UserError
from groundlink.episode.checkpoint import Checkpoint
from groundlink.episode.checkpoint import loaded as load_checkpoint
from groundlink.episode.journal import Journal, loaded
from groundlink.scenario import Scenario

from . import metadata

_RECORD = struct.Struct("<BQ")
"""Opcode and length: the head of a record."""

_MESSAGE = struct.Struct("<HIQQ")
"""Channel, sequence number, log time, publish time: the fields of a Message before its data."""

_nanos = attrgetter("nanos")


class RecordedMessage(NamedTuple):
    """A recorded message."""

    nanos: int
    """Log time, in the time of the run."""

    topic: str
    ros_type: str
    cdr: bytes


T = TypeVar("T")


class Attached(NamedTuple, Generic[T]):
    """Something that is attached to a recording."""

    nanos: int
    """Its log time."""

    load: Callable[[], T]
    """Returns it; raises a UserError when it is damaged or of another version."""


class Recording:
    """A recording, open for reading.

    Raises
    ------
    UserError
        when the file is missing, or is no recording of a run.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise UserError(f"{path}: {(error.strerror or str(error)).lower()}") from None
        try:
            self._read()
        except UserError:
            self._file.close()
            raise
        except (McapError, msgspec.MsgspecError, struct.error, ValueError, OSError) as error:
            self._file.close()
            raise UserError(
                f"{path}: not a recording of a run: {_reason(error)}; expected an MCAP file that "
                "`groundlink record` wrote. Fix: repair a truncated file with `mcap recover`"
            ) from None

    def _read(self) -> None:
        self._reader = SeekingReader(self._file)
        summary = self._reader.get_summary()
        records = {record.name: record.metadata for record in self._reader.iter_metadata()}
        if summary is None or summary.statistics is None or metadata.RUN_RECORD not in records:
            raise UserError(
                f"{self.path}: an MCAP file without a run; expected a file of `groundlink record`"
            )
        self.run: metadata.RunFacts = metadata.run_facts(records[metadata.RUN_RECORD])
        self.topics: dict[str, metadata.TopicFacts] = metadata.topic_facts(
            records.get(metadata.TOPICS_RECORD, {})
        )
        """Statistics by topic, as counted by the recorder."""

        end = records.get(metadata.END_RECORD)
        self.end_nanos: int | None = None if end is None else int(end["nanos"])
        """The recording is complete up to this stamp; None if it was ended early."""

        self.dropped: dict[str, int] = {
            topic: int(count) for topic, count in records.get(metadata.DROPPED_RECORD, {}).items()
        }
        """Messages dropped by the recorder, by topic."""

        self._channels, self._schemas = summary.channels, {0: ""}
        self._schemas |= {id: schema.name for id, schema in summary.schemas.items()}
        self._chunks = sorted(
            summary.chunk_indexes, key=attrgetter("message_start_time", "chunk_start_offset")
        )
        self.messages: int = summary.statistics.message_count
        self.first_nanos: int = summary.statistics.message_start_time
        self.last_nanos: int = summary.statistics.message_end_time
        self.types: dict[str, str] = {
            channel.topic: summary.schemas[channel.schema_id].name
            for channel in summary.channels.values()
        }
        """ROS type by declared topic."""

        self.definitions: dict[str, str] = {
            schema.name: schema.data.decode(errors="replace") for schema in summary.schemas.values()
        }
        """Full definition of each declared ROS type."""

    def __enter__(self) -> "Recording":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @cached_property
    def journal(self) -> Journal | None:
        """The recorded part of the run's journal, or None.

        Raises
        ------
        UserError
            when it is damaged or of another version.
        """
        found: Journal | None = None
        for part in self.journal_parts:
            journal = part.load()
            found = journal if found is None else found.followed_by(journal)
        return found

    @property
    def journal_parts(self) -> "list[Attached[Journal]]":
        """The parts of the journal, in the order of their times."""
        return self._attached(metadata.JOURNAL_ATTACHMENT, loaded)

    @property
    def checkpoints(self) -> "list[Attached[Checkpoint]]":
        """The checkpoints, in the order of their times."""
        return self._attached(metadata.CHECKPOINT_ATTACHMENT, load_checkpoint)

    def _attached(self, name: str, load: Callable[[bytes, str], T]) -> "list[Attached[T]]":
        summary = self._reader.get_summary()
        indexes = summary.attachment_indexes if summary else ()
        found = [
            Attached(index.log_time, partial(self._load, index.offset, load))
            for index in indexes
            if index.name == name
        ]
        return sorted(found, key=lambda each: each.nanos)

    def _load(self, offset: int, load: Callable[[bytes, str], T]) -> T:
        """Return what is attached at an offset of the file."""
        self._file.seek(offset)
        try:
            record = next(StreamReader(self._file, skip_magic=True).records)
        except (McapError, StopIteration, struct.error, ValueError) as error:
            raise UserError(f"{self.path}: damaged: {_reason(error)}") from None
        if not isinstance(record, Attachment):
            raise UserError(f"{self.path}: damaged: an attachment is not where its index says")
        return load(record.data, str(self.path))

    @property
    def started_as(self) -> Scenario:
        """The scenario at tick 0, as far as known."""
        return self.journal.scenario if self.journal else self.run.scenario

    def read(
        self, topics: Sequence[str] | None = None, *, from_nanos: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of some topics, or of all, in order of time.

        Raises
        ------
        UserError
            where the file is damaged.
        """
        channels = {
            id: (channel.topic, self._schemas[channel.schema_id])
            for id, channel in self._channels.items()
            if topics is None or channel.topic in topics
        }
        first = from_nanos or 0
        waiting: list[RecordedMessage] = []
        try:
            for chunk in self._chunks:
                if chunk.message_end_time < first or channels.keys().isdisjoint(
                    chunk.message_index_offsets
                ):
                    continue
                # Chunks are in order of their begins, but may overlap.
                passed = bisect_right(waiting, chunk.message_start_time, key=_nanos)
                yield from waiting[:passed]
                del waiting[:passed]
                for channel, nanos, cdr in _messages(self._plain(chunk)):
                    if channel in channels and nanos >= first:
                        waiting.append(RecordedMessage(nanos, *channels[channel], bytes(cdr)))
                waiting.sort(key=_nanos)
            yield from waiting
        except (McapError, ZstdError, struct.error, ValueError) as error:
            raise UserError(f"{self.path}: damaged: {_reason(error)}") from None

    def _plain(self, chunk: ChunkIndex) -> bytes:
        """Return the records of a chunk."""
        self._file.seek(chunk.chunk_start_offset + _RECORD.size)
        stream, size = get_chunk_data_stream(Chunk.read(ReadDataStream(self._file)))
        return stream.read(size)


def _messages(records: bytes) -> Iterator[tuple[int, int, memoryview]]:
    """Yield channel, log time and data of each message of a chunk.

    Raises
    ------
    ValueError
        when they are damaged.
    """
    whole, end = memoryview(records), 0
    while end < len(records):
        opcode, length = _RECORD.unpack_from(records, end)
        begin, end = end + _RECORD.size, end + _RECORD.size + length
        if end > len(records):
            raise ValueError("a record is longer than its chunk")
        if opcode == Opcode.MESSAGE:
            channel, _, nanos, _ = _MESSAGE.unpack_from(records, begin)
            yield channel, nanos, whole[begin + _MESSAGE.size : end]


def _reason(error: Exception) -> str:
    """Return the reason of a read error as text."""
    if isinstance(error, EndOfFile | struct.error):
        return "it ends too early"
    if isinstance(error, InvalidMagic):
        return "it does not begin or end as MCAP files do"
    return " ".join(str(error).split()) or "it cannot be read"
