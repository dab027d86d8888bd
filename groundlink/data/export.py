# SPDX-License-Identifier: Apache-2.0
"""Export of a recorded run to files of other tools, in one pass over its messages.

Names of files derive from topics: `/lidar/points` becomes `lidar_points`. A format with one file
for each message has a folder of numbered files, with their stamps in `times.txt`. Memory holds the
poses of the run and `_BATCH` messages of each other topic.
"""

from abc import abstractmethod
from array import array
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.core.errors import UserError, did_you_mean
from groundlink.ros.types import nanos, xyz, xyzw

from .dataset import Dataset
from .formats import (
    ParquetFile,
    append_csv,
    write_kitti_poses,
    write_pcd,
    write_png,
    write_times,
    write_velodyne,
)
from .kitti_objects import KittiObjects
from .ros_arrays import CLOUDS, IMAGES, POSES, columns, content, items, record_array
from .topic_export import TopicExport, UnsuitableMessages
from .trajectory import Trajectory, write_tum

_BATCH = 250
"""Records that are written at once."""

Message = tuple[str, int, Any]
"""Topic, time in nanoseconds, message."""

Watch = Callable[[Iterable[Message], int | None], Iterable[Message]]
"""A function that passes messages on and shows the progress, of a total if that is known."""


@dataclass(frozen=True)
class ExportedPath:
    """A file or folder of an export."""

    path: str
    """Relative to the folder of the export; a folder ends in `/`."""

    topic: str
    messages: int


@dataclass(frozen=True)
class ExportSummary:
    """What was exported, and what was not."""

    paths: list[ExportedPath]
    left_out: dict[str, str]
    """Reason by topic."""


class _Poses(TopicExport):
    """Poses, collected until the end.

    Parameters
    ----------
    mount
        x, y, z, qx, qy, qz, qw of a frame on the body, whose poses are written instead.
    """

    def __init__(
        self, dataset: Dataset, topic: str, stem: Path, mount: Sequence[float] | None = None
    ) -> None:
        super().__init__(dataset, topic, stem)
        self._mount = mount
        self._stamps: list[int] = []
        self._poses = array("d")

    @staticmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        return dataset.ros_type(topic) in POSES

    def add(self, time_nanos: int, message: Any) -> None:
        pose = message
        for part in POSES[message.__msgtype__].split("."):
            pose = getattr(pose, part)
        self._stamps.append(nanos(message.header.stamp))
        self._poses.extend((*xyz(pose.position), *xyzw(pose.orientation)))
        self.messages += 1

    def close(self) -> None:
        poses = np.array(self._poses).reshape(-1, 7)
        body = Trajectory(np.array(self._stamps) / NANOS, poses[:, :3], poses[:, 3:])
        self.write(body if self._mount is None else body.seen_from(self._mount), self._stamps)

    @abstractmethod
    def write(self, trajectory: Trajectory, stamps: Sequence[int]) -> None:
        """Write all poses."""


class _TumFile(_Poses):
    format, ending = "tum", ".tum"

    def write(self, trajectory: Trajectory, stamps: Sequence[int]) -> None:
        write_tum(self.path, trajectory)


class _KittiPoses(_Poses):
    format, ending = "kitti", "/kitti/"

    def write(self, trajectory: Trajectory, stamps: Sequence[int]) -> None:
        self.path.mkdir(parents=True)
        write_kitti_poses(self.path / "poses.txt", trajectory)
        write_times(self.path / "times.txt", stamps)


class _NumberedFiles(TopicExport):
    """A file for each message, numbered from 0, and their stamps."""

    suffix: ClassVar[str]
    folder: ClassVar[str] = ""
    """Of the numbered files, inside of the output's."""

    def __init__(self, dataset: Dataset, topic: str, stem: Path) -> None:
        super().__init__(dataset, topic, stem)
        self._stamps: list[int] = []

    def add(self, time_nanos: int, message: Any) -> None:
        stamp = nanos(message.header.stamp)
        if not self.is_wanted(stamp):
            return
        try:
            values = content(message)
        except KeyError as error:
            raise UnsuitableMessages(f"unknown encoding of an image: {error}") from None
        assert values is not None
        folder = self.path / self.folder
        folder.mkdir(parents=True, exist_ok=True)
        self.write(folder / f"{self.messages:06d}{self.suffix}", values)
        self._stamps.append(stamp)
        self.messages += 1

    def close(self) -> None:
        write_times(self.path / "times.txt", self._stamps)

    def is_wanted(self, stamp: int) -> bool:
        """Return whether a message is written."""
        return True

    @abstractmethod
    def write(self, file: Path, values: NDArray[Any]) -> None:
        """Write the points or pixels of a message."""


class _PcdFiles(_NumberedFiles):
    format, ending, suffix = "pcd", "/pcd/", ".pcd"

    @staticmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        return dataset.ros_type(topic) in CLOUDS

    def write(self, file: Path, values: NDArray[Any]) -> None:
        write_pcd(file, values)


class _PngFiles(_NumberedFiles):
    format, ending, suffix = "png", "/png/", ".png"

    @staticmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        return dataset.ros_type(topic) in IMAGES

    def write(self, file: Path, values: NDArray[Any]) -> None:
        write_png(file, values)


class _KittiScans(_NumberedFiles):
    """Scans, with the true pose of the sensor at the stamp of each.

    Where the recording has a truth, scans outside of its time are left out, so that each scan has a
    pose.
    """

    format, ending, folder, suffix = "kitti", "/kitti/", "velodyne", ".bin"

    def __init__(self, dataset: Dataset, topic: str, stem: Path) -> None:
        super().__init__(dataset, topic, stem)
        self._truth: Trajectory | None = None
        sensor = dataset.sensor_frame(topic)
        truth = dataset.topics.get(dataset.truth_topic(sensor[0])) if sensor else None
        if sensor and truth and truth.messages:
            self._truth = dataset.truth(*sensor)

    @staticmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        return dataset.ros_type(topic) in CLOUDS

    def is_wanted(self, stamp: int) -> bool:
        if self._truth is None:
            return True
        return bool(self._truth.seconds[0] <= stamp / NANOS <= self._truth.seconds[-1])

    def write(self, file: Path, values: NDArray[Any]) -> None:
        write_velodyne(file, values)

    def close(self) -> None:
        super().close()
        if self._truth is not None:
            poses = self._truth.at(np.array(self._stamps) / NANOS)
            write_kitti_poses(self.path / "poses.txt", poses)


class _Records(TopicExport):
    """Messages of numbers, as rows."""

    def __init__(self, dataset: Dataset, topic: str, stem: Path) -> None:
        super().__init__(dataset, topic, stem)
        self._batch: list[tuple[int, Any]] = []
        self._record: np.dtype[np.void] | None = None

    @staticmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        return dataset.ros_type(topic) not in CLOUDS | IMAGES

    def add(self, time_nanos: int, message: Any) -> None:
        self._batch.extend(items([(time_nanos, message)]))
        self.messages += 1
        if len(self._batch) >= _BATCH:
            self._flush()

    def close(self) -> None:
        if self._batch:
            self._flush()
        if self._record is None:
            raise UnsuitableMessages("lists without an entry")

    def _flush(self) -> None:
        try:
            found = record_array(self._batch, self._record)
        except ValueError:
            raise UnsuitableMessages("lists that differ in length") from None
        if found.dtype.names == ("stamp",):
            raise UnsuitableMessages("text or lists of messages")
        sample = self._batch[-1][1]
        self._record, self._batch = found.dtype, []
        self.append(columns(found, sample))

    @abstractmethod
    def append(self, columns: Mapping[str, NDArray[Any]]) -> None:
        """Append rows to the file."""


class _CsvFile(_Records):
    format, ending = "csv", ".csv"

    def append(self, columns: Mapping[str, NDArray[Any]]) -> None:
        append_csv(self.path, columns)


class _ParquetTable(_Records):
    format, ending = "parquet", ".parquet"

    def __init__(self, dataset: Dataset, topic: str, stem: Path) -> None:
        super().__init__(dataset, topic, stem)
        self._file = ParquetFile(self.path)

    def append(self, columns: Mapping[str, NDArray[Any]]) -> None:
        self._file.append(columns)

    def close(self) -> None:
        super().close()
        self._file.close()


_POSE_OUTPUTS: tuple[type[_Poses], ...] = (_TumFile, _KittiPoses)

_OUTPUTS: tuple[type[TopicExport], ...] = (
    *_POSE_OUTPUTS,
    _KittiScans,
    _PcdFiles,
    _PngFiles,
    KittiObjects,
    _CsvFile,
    _ParquetTable,
)


def export(
    dataset: Dataset,
    folder: Path,
    *,
    formats: Collection[str],
    topics: Sequence[str] = (),
    frames: Sequence[str] = (),
    start_s: float | None = None,
    end_s: float | None = None,
    watch: Watch = lambda messages, total: messages,
) -> ExportSummary:
    """Write the topics of a recording into an existing folder.

    Parameters
    ----------
    formats
        names of `formats.FORMATS`.
    topics
        all topics with messages if empty.
    frames
        frames of sensors, whose true poses are written as TUM and KITTI trajectories.
    start_s, end_s
        sim time in seconds, start included, end not.

    Raises
    ------
    UserError
        when the recording lacks a topic or a frame, or is damaged.
    """
    recorded = (topic for topic, facts in dataset.topics.items() if facts.messages)
    chosen = list(dict.fromkeys(topics or recorded))
    true_frames = {
        f"{dataset.truth_topic(vehicle)}/{frame}": (vehicle, frame)
        for frame in frames
        for vehicle in _vehicles_with(dataset, frame)
    }
    stems = {name: folder / file for name, file in _file_names([*chosen, *true_frames]).items()}
    outputs = [
        kind(dataset, topic, stems[topic])
        for topic in chosen
        for kind in _OUTPUTS
        if kind.format in formats and kind.takes(dataset, topic)
    ]
    outputs += [
        kind(dataset, dataset.truth_topic(vehicle), stems[name], dataset.mount(vehicle, frame))
        for name, (vehicle, frame) in true_frames.items()
        for kind in _POSE_OUTPUTS
        if kind.format in formats
    ]
    left_out = dict.fromkeys(chosen, "no chosen format fits the type")
    by_topic: dict[str, list[TopicExport]] = {}
    for output in outputs:
        for topic in output.inputs:
            by_topic.setdefault(topic, []).append(output)
        left_out.pop(output.topic, None)
    messages = dataset.interleaved(by_topic, start_s=start_s, end_s=end_s)
    total = sum(facts.messages for topic, facts in dataset.topics.items() if topic in by_topic)
    whole = start_s is None and end_s is None
    for topic, time_nanos, message in watch(messages, total if whole else None):
        for output in by_topic[topic]:
            if not output.unsuitable:
                with output.fitting():
                    output.add(time_nanos, message)
    for output in outputs:
        if output.messages:
            with output.fitting():
                output.close()
        if not output.messages:
            left_out[output.topic] = output.unsuitable or "no messages in this span"
    paths = [
        ExportedPath(
            f"{output.path.relative_to(folder)}{'/' if output.path.is_dir() else ''}",
            output.topic,
            output.messages,
        )
        for output in outputs
        if output.messages
    ]
    return ExportSummary(sorted(paths, key=lambda found: found.path), left_out)


def _vehicles_with(dataset: Dataset, frame: str) -> list[str]:
    """Return the vehicles with a frame. Raises UserError if there are none."""
    frames = dataset.frames
    vehicles = [vehicle for vehicle, known in frames.items() if frame in known]
    if not vehicles:
        known = {name for of_vehicle in frames.values() for name in of_vehicle}
        raise UserError(f"{dataset.path}: no frame `{frame}`; {did_you_mean(frame, known)}")
    return vehicles


def _file_names(topics: Iterable[str]) -> dict[str, str]:
    """Return a file name for each topic: `lidar_points` for `/lidar/points`.

    Of topics that would have the same name, later ones get underscores.
    """
    names: dict[str, str] = {}
    for topic in topics:
        name = topic.strip("/").replace("/", "_")
        while name in names.values():
            name += "_"
        names[topic] = name
    return names
