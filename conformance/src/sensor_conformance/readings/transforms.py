# SPDX-License-Identifier: Apache-2.0
"""Transforms of /tf and /tf_static, and the tree they form."""

from typing import Any

import numpy as np

from sensor_conformance.signals.rotations import inverse, normalized, product, rotate

from .base import Floats, Times, TopicReadings, nanoseconds, quaternion, vector


class TransformReadings(TopicReadings):
    """Readings of tf2_msgs/TFMessage; the stamps are those of the first transform of a message."""

    types = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

    def prepare(self) -> None:
        """Create the lists."""
        self._rows: dict[tuple[str, str], list[tuple[float, ...]]] = {}
        self._stamps: dict[tuple[str, str], list[int]] = {}

    def take(self, index: int, message: Any) -> None:
        """Take each transform."""
        for one in message.transforms:
            edge = str(one.header.frame_id), str(one.child_frame_id)
            self.frames[edge[0]] = None
            value = one.transform
            self._stamps.setdefault(edge, []).append(nanoseconds(one.header.stamp))
            self._rows.setdefault(edge, []).append(
                (*vector(value.translation), *quaternion(value.rotation))
            )

    def finish(self) -> None:
        """Make the arrays: for each pair of parent and child stamps, meters, quaternions."""
        self.edges: dict[tuple[str, str], tuple[Times, Floats, Floats]] = {}
        for edge, given in self._rows.items():
            rows = np.array(given, np.float64).reshape(-1, 7)
            self.edges[edge] = np.array(self._stamps[edge], np.int64), rows[:, :3], rows[:, 3:]

    @property
    def is_static(self) -> bool:
        """Whether the topic is that of static transforms."""
        return self.name.endswith("tf_static")


class FrameTree:
    """All transforms of a recording, as a tree of frames."""

    def __init__(self, topics: list[TransformReadings]) -> None:
        self.edges: dict[tuple[str, str], tuple[Times, Floats, Floats]] = {}
        self.static: set[tuple[str, str]] = set()
        for topic in topics:
            self.edges |= topic.edges
            if topic.is_static:
                self.static |= set(topic.edges)
        self.parents: dict[str, list[str]] = {}
        for parent, child in self.edges:
            self.parents.setdefault(child, []).append(parent)

    @property
    def frames(self) -> set[str]:
        """All frames."""
        return {frame for edge in self.edges for frame in edge}

    def line(self, frame: str) -> list[str]:
        """Return a frame and its ancestors, up to the root or to a frame that repeats."""
        found = [frame]
        while (above := self.parents.get(found[-1])) and above[0] not in found:
            found.append(above[0])
        return found

    def mount(self, frame: str, base: str) -> tuple[Floats, Floats] | None:
        """Return translation and rotation from a frame to another one over static transforms.

        Returns
        -------
        tuple or None
            Meters and quaternion of `frame` in `base`; None if static transforms don't join them.
        """
        up, down = self._to_fixed_root(frame), self._to_fixed_root(base)
        if up[0] != down[0]:
            return None
        back = inverse(down[2])
        return rotate(back, up[1] - down[1]), product(back, up[2])

    def _to_fixed_root(self, frame: str) -> tuple[str, Floats, Floats]:
        """Return the highest frame above one over static transforms, and the pose in it."""
        position, rotation = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
        seen = {frame}
        while above := self.parents.get(frame):
            edge = above[0], frame
            if edge not in self.static or above[0] in seen:
                break
            _, translations, rotations = self.edges[edge]
            unit = normalized(rotations[-1])
            position = rotate(unit, position) + translations[-1]
            rotation = product(unit, rotation)
            frame = above[0]
            seen.add(frame)
        return frame, position, rotation
