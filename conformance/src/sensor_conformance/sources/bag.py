# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1 (.bag), ROS 2 (folder, .db3) and MCAP files (.mcap)."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from .source import Received, SourceTopic, UnreadableSource

DRIVERS = {
    "pandar_msgs/msg/PandarPacket": (
        "builtin_interfaces/Time stamp\nuint8[1500] data\nuint32 size"
    ),
    "pandar_msgs/msg/PandarScan": ("std_msgs/Header header\npandar_msgs/PandarPacket[] packets"),
    "velodyne_msgs/msg/VelodynePacket": "builtin_interfaces/Time stamp\nuint8[1206] data",
    "velodyne_msgs/msg/VelodyneScan": (
        "std_msgs/Header header\nvelodyne_msgs/VelodynePacket[] packets"
    ),
}
"""Definitions of messages of drivers, for bags without them."""


class BagSource:
    """A recorded bag, open as a context manager.

    Parameters
    ----------
    path
        A file ``.bag``, ``.db3`` or ``.mcap``, or the folder of a ROS 2 bag.
    duration
        Seconds to read from the beginning; all by default.

    Raises
    ------
    UnreadableSource
        If the file is missing, broken, or no bag.
    """

    def __init__(self, path: Path, duration: float | None = None) -> None:
        self.name = path.name
        self._path = path
        self._duration = duration

    def __enter__(self) -> Self:
        # Bags of older ROS 2 versions hold no definitions of their types.
        store = get_typestore(Stores.ROS2_HUMBLE)
        for name, definition in DRIVERS.items():
            store.register(get_types_from_msg(definition, name))
        try:
            self._reader = AnyReader([self._path], default_typestore=store)
            self._reader.open()
        except Exception as error:  # the reader raises errors of many libraries for broken bytes
            raise UnreadableSource(f"{self._path}: no readable bag: {error}") from error
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._reader.close()

    def topics(self) -> Sequence[SourceTopic]:
        """Return all topics that have messages."""
        connections = [one for one in self._reader.connections if one.msgcount]
        unique = {one.topic: SourceTopic(one.topic, one.msgtype) for one in connections}
        return tuple(unique[name] for name in sorted(unique))

    def messages(self, topic: str) -> Iterator[Received]:
        """Yield the messages of a topic in the order of their arrival."""
        reader = self._reader
        end = None
        if self._duration is not None:
            end = reader.start_time + int(self._duration * 1e9)
        connections = [one for one in reader.connections if one.topic == topic]
        try:
            for connection, time, raw in reader.messages(connections, stop=end):
                yield Received(time, reader.deserialize(raw, connection.msgtype))
        except AnyReaderError as error:
            raise UnreadableSource(f"{self._path}: {topic}: {error}") from error
