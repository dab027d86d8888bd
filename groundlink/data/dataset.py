# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays: `groundlink.open("run.mcap")`."""

from collections.abc import Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.core.errors import RequirementError, UserError
from groundlink.recording.metadata import TopicFacts
from groundlink.recording.reader import Recording
from groundlink.ros.streams import mounts
from groundlink.ros.types import STORE
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Vehicle

from .ros_arrays import components, content, row
from .trajectory import Trajectory

_POSES = {
    "nav_msgs/msg/Odometry": "pose.pose",
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
}
"""Field of the pose by ROS type."""


class Dataset:
    """A recorded run, open for reading. Memory holds only what a call returns.

    Times `start_s` and `end_s` are sim times in seconds from the start of the run, start included
    and end not. Stamps are integers: nanoseconds, as in the headers of the messages.

    Raises
    ------
    UserError
        when the file is missing or no recording of a run.
    """

    def __init__(self, path: str | Path) -> None:
        self._recording = Recording(Path(path))

    def __enter__(self) -> "Dataset":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._recording.path}: {len(self.topics)} topics>"

    def close(self) -> None:
        """Close the file."""
        self._recording.close()

    @property
    def topics(self) -> Mapping[str, TopicFacts]:
        """ROS type, number of messages, first and last stamp of each topic, by name."""
        return self._recording.topics

    @property
    def scenario(self) -> Scenario:
        """The scenario, with every default."""
        return self._recording.run.scenario

    @property
    def start_nanos(self) -> int:
        """Stamp of sim time zero."""
        return self._recording.run.epoch_nanos

    def messages(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Yield time (nanoseconds) and message of a topic; messages have the fields of ROS.

        Raises
        ------
        UserError
            when the recording lacks the topic or is damaged.
        """
        if topic not in self._recording.types:
            known = ", ".join(sorted(self._recording.types))
            raise UserError(f"{self._recording.path}: no topic `{topic}`; expected one of {known}")
        begin = None if start_s is None else self.start_nanos + round(start_s * NANOS)
        end = None if end_s is None else self.start_nanos + round(end_s * NANOS)
        for recorded in self._recording.read([topic], from_nanos=begin):
            if end is not None and recorded.nanos >= end:
                return
            yield recorded.nanos, STORE.deserialize_cdr(recorded.cdr, recorded.ros_type)

    def contents(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield stamp and array of each point cloud or image of a topic.

        Clouds are structured arrays, shape (N,), with the fields of the cloud; images have the
        shape (height, width) or (height, width, channels).

        Raises
        ------
        UserError
            when the topic has another type, or an image an unknown encoding.
        """
        for _, message in self.messages(topic, start_s=start_s, end_s=end_s):
            try:
                array = content(message)
            except KeyError as error:
                raise UserError(f"{topic}: unknown encoding of an image: {error}") from None
            if array is None:
                raise UserError(
                    f"{topic} has {message.__msgtype__}; expected point clouds or images. "
                    "Fix: use `array`"
                )
            yield int(dict(row(message))["stamp"]), array

    def array(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> NDArray[np.void]:
        """Return the messages of a topic as a structured array, one record for each message.

        Its fields are those of the ROS type: `stamp` (int64, nanoseconds; of the recording, where
        messages have no header), numbers, and vectors such as `linear_acceleration`, shape (N, 3),
        and `orientation`, shape (N, 4), xyzw. Fields of nested messages have dotted names, such as
        `pose.pose.position`. Text is left out.

        Raises
        ------
        UserError
            when messages differ in the length of a list, or have one content each (clouds, images).
        """
        return self._table(topic, start_s, end_s)[0]

    def dataframe(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Any:
        """Return `array` as a pandas.DataFrame with a column for each component.

        Columns of vectors are named like `linear_acceleration.x`; those of lists have a number.

        Raises
        ------
        RequirementError
            when pandas is not installed.
        """
        try:
            import pandas
        except ImportError:
            raise RequirementError(
                "data frames need the Python package `pandas`. Fix: pip install pandas"
            ) from None
        table, sample = self._table(topic, start_s, end_s)
        columns: dict[str, NDArray[Any]] = {}
        for name in table.dtype.names or ():
            if table[name].ndim == 1:
                columns[name] = table[name]
                continue
            flat = table[name].reshape(len(table), -1)
            for i, part in enumerate(components(sample, name)):
                columns[f"{name}.{part}"] = flat[:, i]
        return pandas.DataFrame(columns)

    def poses(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Trajectory:
        """Return the poses of a topic with odometry or poses.

        Raises
        ------
        UserError
            when the topic has another type or no messages.
        """
        ros_type = self._recording.types.get(topic, "")
        table = self.array(topic, start_s=start_s, end_s=end_s)
        if ros_type not in _POSES:
            raise UserError(f"{topic} has {ros_type}; expected poses: {', '.join(sorted(_POSES))}")
        field = _POSES[ros_type]
        return Trajectory(
            table["stamp"] / NANOS, table[f"{field}.position"], table[f"{field}.orientation"]
        )

    def truth(self, vehicle: str | None = None, frame: str | None = None) -> Trajectory:
        """Return the true poses of a vehicle's frame in the world: world_from_frame.

        `truth(...).at(stamps / 1e9)` interpolates them at any stamps.

        Parameters
        ----------
        vehicle
            name of the vehicle; the first one if None.
        frame
            frame of a sensor, such as `lidar_link`; the vehicle's base if None.

        Raises
        ------
        UserError
            when the run has no such vehicle or frame.
        """
        chosen = self._vehicle(vehicle)
        base = self._base(chosen.name)
        frames = {mount.child: mount for mount in mounts(chosen, 0)}
        if frame is None or frame == chosen.model.base_frame:
            return base
        if frame not in frames:
            known = ", ".join(sorted({chosen.model.base_frame, *frames}))
            raise UserError(f"{chosen.name}: no frame `{frame}`; expected one of {known}")
        mount = frames[frame]
        return base.seen_from((*mount.translation_m, *mount.rotation))

    def _vehicle(self, name: str | None) -> Vehicle:
        vehicles = {vehicle.name: vehicle for vehicle in self.scenario.vehicles}
        if name is None and vehicles:
            return next(iter(vehicles.values()))
        if name not in vehicles:
            known = ", ".join(vehicles) or "none"
            raise UserError(f"{self._recording.path}: no vehicle `{name}`; the run has {known}")
        return vehicles[name]

    @cached_property
    def _bases(self) -> dict[str, Trajectory]:
        return {}

    def _base(self, vehicle: str) -> Trajectory:
        if vehicle not in self._bases:
            topic = self.scenario.ground_truth_topic(self._vehicle(vehicle))
            self._bases[vehicle] = self.poses(topic)
        return self._bases[vehicle]

    def _table(
        self, topic: str, start_s: float | None, end_s: float | None
    ) -> tuple[NDArray[np.void], Any]:
        """Return the records of a topic, and one of its messages."""
        rows, sample = [], None
        for time, message in self.messages(topic, start_s=start_s, end_s=end_s):
            if sample is None:
                sample = message
                if content(message) is not None:
                    raise UserError(
                        f"{topic} has {message.__msgtype__}, an array in each message. "
                        "Fix: use `contents`"
                    )
            rows.append({"stamp": np.asarray(time)} | dict(row(message)))
        if not rows:
            raise UserError(f"{topic}: no messages in this span")
        record = np.dtype([(name, value.dtype, value.shape) for name, value in rows[0].items()])
        try:
            return np.array([tuple(found.values()) for found in rows], record), sample
        except ValueError:
            raise UserError(
                f"{topic}: the lists in {sample.__msgtype__} differ in length. "  # type: ignore[union-attr]
                "Fix: use `messages`"
            ) from None
