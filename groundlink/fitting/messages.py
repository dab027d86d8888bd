# SPDX-License-Identifier: Apache-2.0
"""Messages of a recording: ROS 2 bags (SQLite or MCAP), MCAP files and ROS 1 bags."""

import sqlite3
import struct
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mcap.exceptions import McapError
from mcap.reader import make_reader
from rosbags.rosbag1 import Reader, ReaderError

from groundlink.core.errors import UserError
from groundlink.recording.ros1 import NOETIC
from groundlink.ros.types import STORE

UNREADABLE = (sqlite3.Error, McapError, ReaderError, struct.error)
"""Errors of files that are not what their names say."""


class BagMessage(NamedTuple):
    """A message of a recording."""

    topic: str
    ros_type: str
    data: bytes
    """As serialized: CDR, or the form of ROS 1."""

    decode: Callable[[bytes, str], Any]

    def content(self) -> Any:
        """Return the message with the fields of its ROS type."""
        return self.decode(self.data, self.ros_type)


def found_file(path: Path) -> Path:
    """Return the file of a recording that is a file or the folder of a ROS 2 bag.

    Raises
    ------
    UserError
        when there is none.
    """
    if path.is_dir():
        found = sorted([*path.glob("*.db3"), *path.glob("*.mcap")])
        if not found:
            raise UserError(f"{path}: a folder without a .db3 or .mcap file; expected a ROS 2 bag")
        path = found[0]
    if not path.exists():
        raise UserError(f"{path}: no such file")
    return path


def one_topic(
    path: Path, is_wanted: Callable[[BagMessage], bool], topic: str | None, what: str
) -> list[BagMessage]:
    """Return the messages of the one topic of a bag or an MCAP file that has the wanted messages.

    Parameters
    ----------
    is_wanted : function
        Whether a message is of a known type.
    topic : str or None
        Needed where several topics have such messages.
    what : str
        What such messages hold, in the plural, for errors.

    Raises
    ------
    UserError
        when there is no such topic, or nothing says which.
    """
    known = [
        message
        for message in MESSAGES[path.suffix](path)
        if topic in (None, message.topic) and is_wanted(message)
    ]
    topics = sorted({message.topic for message in known})
    if len(topics) != 1:
        raise UserError(
            f"{path}: {len(topics)} topics of {what}: {', '.join(topics) or 'none'}; expected "
            "one. Fix: name it with --topic"
        )
    return known


def _sqlite(path: Path) -> Iterator[BagMessage]:
    with sqlite3.connect(f"file:{path}?mode=ro", uri=True) as bag:
        rows: Iterable[tuple[str, str, bytes]] = bag.execute(
            "SELECT topics.name, topics.type, messages.data FROM messages "
            "JOIN topics ON messages.topic_id = topics.id ORDER BY messages.timestamp"
        )
        for row in rows:
            yield BagMessage(*row, STORE.deserialize_cdr)


def _mcap(path: Path) -> Iterator[BagMessage]:
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if schema is not None:
                yield BagMessage(channel.topic, schema.name, message.data, STORE.deserialize_cdr)


def _ros1(path: Path) -> Iterator[BagMessage]:
    with Reader(path) as bag:
        for connection, _, data in bag.messages():
            decode = NOETIC.deserialize_ros1
            yield BagMessage(connection.topic, connection.msgtype, bytes(data), decode)


MESSAGES: dict[str, Callable[[Path], Iterator[BagMessage]]] = {
    ".bag": _ros1,
    ".db3": _sqlite,
    ".mcap": _mcap,
}
"""Messages in the order of their times, by the suffix of the file."""
