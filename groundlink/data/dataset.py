# SPDX-License-Identifier: Apache-2.0
"""A recorded run as arrays: `groundlink.open("run.mcap")`."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from groundlink.core.clock import NANOS
from groundlink.core.errors import RequirementError, UserError
from groundlink.core.frames import IDENTITY_QUATERNION
from groundlink.expectations.results import ExpectationResult
from groundlink.recording.judging import judged
from groundlink.recording.metadata import TopicFacts
from groundlink.recording.reader import Recording
from groundlink.ros.streams import mounts
from groundlink.ros.types import STORE, nanos, register_unknown
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Vehicle

from .ros_arrays import POSES, columns, content, items, record_array
from .trajectory import Trajectory

_BATCH = 1000
"""Messages that become records at once: as records they take a tenth of the memory."""


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
        self.path = Path(path)
        self._recording = Recording(self.path)
        register_unknown(self._recording.definitions)
        self._bases: dict[str, Trajectory] = {}

    def __enter__(self) -> "Dataset":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.path}: {len(self.topics)} topics>"

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

    def expectations(self) -> list[ExpectationResult]:
        """Return the verdicts on the expectations of the scenario, as `groundlink judge` does."""
        return judged(self._recording, self.scenario)

    def messages(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Yield time (nanoseconds) and message of a topic; messages have the fields of ROS.

        Raises
        ------
        UserError
            when the recording lacks the topic or is damaged.
        """
        for _, time_nanos, message in self.interleaved([topic], start_s=start_s, end_s=end_s):
            yield time_nanos, message

    def interleaved(
        self,
        topics: Iterable[str],
        *,
        start_s: float | None = None,
        end_s: float | None = None,
    ) -> Iterator[tuple[str, int, Any]]:
        """Yield topic, time and message of several topics in order of time, as `messages` does.

        This reads the file once, and is therefore faster than `messages` of each topic.

        Raises
        ------
        UserError
            when the recording lacks a topic or is damaged.
        """
        chosen = list(topics)
        for topic in chosen:
            self.ros_type(topic)
        begin, end = self._nanos(start_s), self._nanos(end_s)
        for recorded in self._recording.read(chosen, from_nanos=begin):
            if end is not None and recorded.nanos >= end:
                return
            message = STORE.deserialize_cdr(recorded.cdr, recorded.ros_type)
            yield recorded.topic, recorded.nanos, message

    def contents(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield stamp and array of each point cloud or image of a topic.

        Clouds are structured arrays, shape (N,), with the fields of the cloud; images have the
        shape (height, width) or (height, width, channels), with channels in the order red, green,
        blue, alpha.

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
            yield nanos(message.header.stamp), array

    def array(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> NDArray[np.void]:
        """Return the messages of a topic as a structured array, one record for each message.

        Its fields are those of the ROS type: `stamp` (int64, nanoseconds; of the recording, where
        messages have no header), numbers, and vectors such as `linear_acceleration`, shape (N, 3),
        and `orientation`, shape (N, 4), xyzw. Fields of nested messages have dotted names, such as
        `pose.pose.position`. Text is left out. Each detection of a topic of boxes is a record.

        Raises
        ------
        UserError
            when messages differ in the length of a list, or have one content each (clouds, images).
        """
        return self._records(topic, start_s, end_s)[0]

    def dataframe(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Any:
        """Return `array` as a pandas.DataFrame with a column for each component.

        Columns of vectors are named like `linear_acceleration.x`, those of lists like
        `position.wheel` where the message names the elements, else like `ranges.0`.

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
        return pandas.DataFrame(columns(*self._records(topic, start_s, end_s)))

    def poses(
        self, topic: str, *, start_s: float | None = None, end_s: float | None = None
    ) -> Trajectory:
        """Return the poses of a topic with odometry or poses.

        Raises
        ------
        UserError
            when the topic has another type or no messages.
        """
        ros_type = self.ros_type(topic)
        if ros_type not in POSES:
            raise UserError(f"{topic} has {ros_type}; expected poses: {', '.join(sorted(POSES))}")
        found = self.array(topic, start_s=start_s, end_s=end_s)
        field = POSES[ros_type]
        return Trajectory(
            found["stamp"] / NANOS, found[f"{field}.position"], found[f"{field}.orientation"]
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
        chosen = self._vehicle(vehicle).name
        base = self._base(chosen)
        if frame is None or frame == self._vehicle(chosen).model.base_frame:
            return base
        return base.seen_from(self.mount(chosen, frame))

    def truth_topic(self, vehicle: str) -> str:
        """Return the topic of a vehicle's true poses."""
        return self.scenario.ground_truth_topic(self._vehicle(vehicle))

    @property
    def frames(self) -> dict[str, list[str]]:
        """The frames of each vehicle, without its frame prefix: its base, then its sensors'."""
        return {
            vehicle.name: [vehicle.model.base_frame, *(m.child for m in mounts(vehicle, 0))]
            for vehicle in self.scenario.vehicles
        }

    def mount(self, vehicle: str, frame: str) -> tuple[float, ...]:
        """Return base_from_frame of a vehicle: x, y, z, qx, qy, qz, qw.

        Raises
        ------
        UserError
            when the run has no such vehicle or frame, or a joint moves the frame.
        """
        chosen = self._vehicle(vehicle)
        if frame == chosen.model.base_frame:
            return (0.0, 0.0, 0.0, *IDENTITY_QUATERNION)
        for mount in mounts(chosen, 0):
            if mount.child == frame:
                if mount.parent != chosen.model.base_frame:
                    raise UserError(
                        f"{vehicle}: frame `{frame}` moves with `{mount.parent}`; expected a frame "
                        "that is fixed to the base"
                    )
                return (*mount.translation_m, *mount.rotation)
        known = ", ".join(sorted(self.frames[vehicle]))
        raise UserError(f"{vehicle}: no frame `{frame}`; expected one of {known}")

    def sensor_frame(self, topic: str) -> tuple[str, str] | None:
        """Return the vehicle and the frame of the sensor that publishes a topic, for `truth`.

        None for a topic of no mounted sensor.
        """
        for vehicle in self.scenario.vehicles:
            for sensor in vehicle.sensors:
                if sensor.mounted and topic in sensor.ros_topics().values():
                    return vehicle.name, sensor.frame
        return None

    def ros_type(self, topic: str) -> str:
        """Return the ROS type of a topic.

        Raises
        ------
        UserError
            when the recording lacks the topic.
        """
        types = self._recording.types
        if topic not in types:
            known = ", ".join(sorted(types))
            raise UserError(f"{self.path}: no topic `{topic}`; expected one of {known}")
        return types[topic]

    def _nanos(self, seconds: float | None) -> int | None:
        """Return the stamp of a sim time."""
        return None if seconds is None else self.start_nanos + round(seconds * NANOS)

    def _vehicle(self, name: str | None) -> Vehicle:
        vehicles = {vehicle.name: vehicle for vehicle in self.scenario.vehicles}
        if name is None and vehicles:
            return next(iter(vehicles.values()))
        if name not in vehicles:
            known = ", ".join(vehicles) or "none"
            raise UserError(f"{self.path}: no vehicle `{name}`; the run has {known}")
        return vehicles[name]

    def _base(self, vehicle: str) -> Trajectory:
        if vehicle not in self._bases:
            self._bases[vehicle] = self.poses(self.truth_topic(vehicle))
        return self._bases[vehicle]

    def _records(
        self, topic: str, start_s: float | None, end_s: float | None
    ) -> tuple[NDArray[np.void], Any]:
        """Return the records of a topic, and one of its messages."""
        messages = items(self.messages(topic, start_s=start_s, end_s=end_s))
        batches: list[NDArray[np.void]] = []
        sample: Any = None
        while batch := list(islice(messages, _BATCH)):
            sample = batch[0][1]
            if content(sample) is not None:
                raise UserError(
                    f"{topic} has {sample.__msgtype__}, an array in each message. "
                    "Fix: use `contents`"
                )
            try:
                batches.append(record_array(batch, batches[0].dtype if batches else None))
            except ValueError:
                raise UserError(
                    f"{topic}: the lists in {sample.__msgtype__} differ in length. "
                    "Fix: use `messages`"
                ) from None
        if not batches:
            raise UserError(f"{topic}: no messages in this span")
        return np.concatenate(batches), sample
