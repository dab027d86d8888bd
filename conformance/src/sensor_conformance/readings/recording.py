# SPDX-License-Identifier: Apache-2.0
"""A whole recording as arrays, and what clauses ask of all its topics together."""

from functools import cached_property
from typing import TypeVar

import numpy as np

from sensor_conformance.signals.rotations import rates, rotate
from sensor_conformance.sources.source import MessageSource, SourceTopic, UnreadableSource

from .base import Floats, Times, TopicReadings
from .cloud import CloudReadings
from .image import CameraInfoReadings, ImageReadings
from .motion import FixReadings, ImuReadings, JointReadings, OdometryReadings
from .packets import (
    HesaiPackets,
    LivoxPackets,
    OusterImuPackets,
    OusterPackets,
    VelodynePackets,
)
from .scan import RangeReadings, ScanReadings
from .transforms import FrameTree, TransformReadings

Readings = TypeVar("Readings", bound=TopicReadings)

READERS: dict[str, type[TopicReadings]] = {
    name: reader
    for reader in (
        CameraInfoReadings,
        CloudReadings,
        FixReadings,
        HesaiPackets,
        ImageReadings,
        ImuReadings,
        JointReadings,
        LivoxPackets,
        OdometryReadings,
        OusterImuPackets,
        OusterPackets,
        RangeReadings,
        ScanReadings,
        TransformReadings,
        VelodynePackets,
    )
    for name in reader.types
}


class CheckedRecording:
    """Readings of all topics of a source.

    Parameters
    ----------
    name
        What reports call it.
    topics
        Readings of every topic.
    unread
        Topics whose messages can't be read, and why.
    """

    def __init__(
        self, name: str, topics: list[TopicReadings], unread: dict[str, str] | None = None
    ) -> None:
        self.name = name
        self.topics = topics
        self.unread = unread or {}

    @classmethod
    def read(cls, source: MessageSource) -> "CheckedRecording":
        """Read a source to its end, topic by topic."""
        topics: list[TopicReadings] = []
        unread: dict[str, str] = {}
        for topic in source.topics():
            try:
                topics.append(read_topic(source, topic))
            except UnreadableSource as error:
                unread[topic.name] = str(error)
        return cls(source.name, topics, unread)

    def of(self, kind: type[Readings]) -> list[Readings]:
        """Return the topics of a kind of readings."""
        return [one for one in self.topics if isinstance(one, kind)]

    def tree_of(self, topic: TopicReadings) -> FrameTree:
        """Return the transforms that are about a topic.

        Those of the nearest namespace that has static ones; of all topics if there are no static
        ones. A topic such as ``/ground_truth/tf`` is a tree of its own.
        """
        space = max(
            (one for one in self._trees if f"{topic.name}/".startswith(f"{one}/")),
            key=len,
            default=None,
        )
        if space is None:
            return self._whole_tree
        found, tree = self._trees[space]
        if isinstance(topic, TransformReadings) and topic not in found:
            return FrameTree([topic])
        return tree

    @cached_property
    def _trees(self) -> dict[str, tuple[list[TransformReadings], FrameTree]]:
        """Topics and tree of each namespace that has static transforms."""
        found = self.of(TransformReadings)
        spaces = {one.name.rpartition("/")[0] for one in found if one.is_static}
        names = {space: (f"{space}/tf", f"{space}/tf_static") for space in spaces}
        topics = {space: [one for one in found if one.name in names[space]] for space in spaces}
        return {space: (some, FrameTree(some)) for space, some in topics.items()}

    @cached_property
    def _whole_tree(self) -> FrameTree:
        return FrameTree(self.of(TransformReadings))

    def odometry_of(self, topic: TopicReadings) -> OdometryReadings | None:
        """Return the odometry of the vehicle that carries a sensor, by tf or by the namespace."""
        line = self.tree_of(topic).line(topic.frame)
        parts = topic.name.split("/")

        def nearness(odometry: OdometryReadings) -> tuple[bool, int]:
            others = odometry.name.split("/")
            same = [a == b for a, b in zip(parts, others, strict=False)]
            return any(child in line for child in odometry.child_frames), [*same, False].index(
                False
            )

        found = [one for one in self.of(OdometryReadings) if len(one.stamps) >= 10]
        return max(found, key=nearness, default=None)

    def turning_of(self, topic: TopicReadings) -> tuple[str, Floats, Floats] | None:
        """Return the reference for turning of the vehicle that carries a sensor.

        Odometry, or else a transform from a frame ``odom`` or ``map``. By the pose, not by the
        twist, so that both can be compared.

        Returns
        -------
        tuple or None
            Name, times in seconds, yaw rates in rad/s of the base.
        """
        if (odometry := self.odometry_of(topic)) is not None:
            return odometry.name, *_yaw_rates(odometry.stamps, odometry.orientation)
        for (parent, child), (stamps, _, quaternions) in self.tree_of(topic).edges.items():
            if parent.rpartition("/")[2] in ("odom", "map") and len(stamps) >= 10:
                return f"{parent} to {child}", *_yaw_rates(stamps, quaternions)
        return None

    def base_of(self, topic: TopicReadings) -> str:
        """Return the frame of the vehicle: the child of odometry, or ``base_link``."""
        odometry = self.odometry_of(topic)
        return next(iter(odometry.child_frames), "base_link") if odometry else "base_link"

    def in_base(self, topic: TopicReadings, vectors: Floats) -> Floats | None:
        """Rotate vectors of a sensor's frame into the base; None if tf does not know its mount."""
        base = self.base_of(topic)
        if topic.frame == base:
            return vectors
        mount = self.tree_of(topic).mount(topic.frame, base)
        return None if mount is None else rotate(mount[1], vectors)


def _yaw_rates(stamps: Times, quaternions: Floats) -> tuple[Floats, Floats]:
    """Return times in seconds and rates between successive orientations of rising stamps."""
    times = stamps / 1e9
    keep = np.flatnonzero(np.diff(times, prepend=-np.inf) > 0)
    middle = np.asarray((times[keep][1:] + times[keep][:-1]) / 2, np.float64)
    return middle, rates(times[keep], quaternions[keep])[:, 2]


def read_topic(source: MessageSource, topic: SourceTopic) -> TopicReadings:
    """Read all messages of a topic."""
    reader = READERS.get(topic.type, TopicReadings)
    return reader(topic, source.messages(topic.name))
