# SPDX-License-Identifier: Apache-2.0
"""Boxes around labeled objects, in pictures and in the frame of a sensor."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from groundlink.core.fields import Quaternion, Vector3
from groundlink.core.frames import Floats, conjugate, matrix_from_quaternion, multiply
from groundlink.messages.base import packed
from groundlink.messages.ground_truth import Detections3D, LabelTable
from groundlink.scene.object_labels import ObjectLabels
from services.sensors.runtime.world_replica import WorldReplica

ORIGIN_BOX = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""Stands for the box of an object without one."""


class ObjectBoxes:
    """Boxes of a world's objects, seen from a sensor on a vehicle.

    Parameters
    ----------
    table : ObjectLabels
    around : WorldReplica
        Gives the order of links in poses.
    vehicle : str
        Name of the sensor's vehicle, which has no box.
    mount : tuple
        Position and rotation of the sensor's frame in the base: base_from_sensor.
    """

    def __init__(
        self,
        table: ObjectLabels,
        around: WorldReplica,
        vehicle: str,
        mount: tuple[Vector3, Quaternion],
    ) -> None:
        self._objects = table.objects
        self._mount = np.array([*mount[0], *mount[1]])
        self._base = around.carrier
        self._movers = {
            table.number_of[name]: around.movers.index(name)
            for name in dict.fromkeys(around.movers)
        }
        """First link of each object that moves: the base of a vehicle."""

        corners = np.array([one.box_m or ORIGIN_BOX for one in table.objects])
        # By number, which begins at 1.
        self._poses = np.array(
            [np.zeros(7), *((*p, *q) for p, q in (o.pose for o in table.objects))]
        )
        self._middles = np.vstack([np.zeros(3), corners.mean(axis=1)])
        self._sizes = np.vstack([np.zeros(3), corners[:, 1] - corners[:, 0]])
        self._boxed = np.array(
            [False, *(one.box_m is not None and one.name != vehicle for one in table.objects)]
        )
        numbers = packed(np.array([*table.classes.values()], np.uint16))
        self.class_table = tuple(table.classes), numbers

    def boxed(self, numbers: NDArray[np.integer]) -> list[int]:
        """Return the objects among `numbers` that have boxes."""
        found: list[int] = numbers[self._boxed[numbers]].tolist()
        return found

    def names(self, numbers: Sequence[int]) -> tuple[str, ...]:
        """Return the names of objects."""
        return tuple(self._objects[number - 1].name for number in numbers)

    def classes(self, numbers: Sequence[int]) -> memoryview:
        """Return the classes of objects, uint16."""
        of_each = [self._objects[number - 1].class_id for number in numbers]
        return packed(np.array(of_each, np.uint16))

    def instance_table(
        self, stamp_nanos: int, frame: str, numbers: NDArray[np.integer]
    ) -> LabelTable:
        """Return the names of the objects among `numbers`."""
        own = [number for number in numbers.tolist() if number]
        return LabelTable(stamp_nanos, frame, self.names(own), packed(np.array(own, np.uint16)))

    def in_space(
        self,
        stamp_nanos: int,
        frame: str,
        numbers: list[int],
        poses: Floats,
        visible: Sequence[float],
    ) -> Detections3D:
        """Return the boxes of objects in the sensor's frame.

        Parameters
        ----------
        poses
            World_from_link at the instant of the boxes, shape (links, 7).
        visible
            Visible share of each object.
        """
        of_objects = self._poses[numbers]
        for row, number in enumerate(numbers):
            if number in self._movers:
                of_objects[row] = poses[self._movers[number]]
        eye = _in_world(poses[self._base], self._mount[:3])
        turn = multiply(poses[self._base, 3:], self._mount[3:])
        middles = _in_world(of_objects, self._middles[numbers]) - eye
        rows = np.empty((len(numbers), 10))
        rows[:, :3] = middles @ matrix_from_quaternion(turn)
        rows[:, 3:7] = multiply(conjugate(turn), of_objects[:, 3:])
        rows[:, 7:] = self._sizes[numbers]
        return Detections3D(
            *(stamp_nanos, frame, self.names(numbers), self.classes(numbers)),
            *(packed(np.array(visible, np.float64)), packed(rows)),
        )


def _in_world(poses: Floats, points: Floats) -> Floats:
    """Return points in the world that are given in frames of these poses."""
    turned = matrix_from_quaternion(poses[..., 3:]) @ points[..., None]
    moved: Floats = poses[..., :3] + turned[..., 0]
    return moved


def boxes_in_picture(instances: NDArray[np.uint16], numbers: Sequence[int]) -> memoryview:
    """Return the box around the pixels of each object: x, y, width, height, float64."""
    rows = np.empty((len(numbers), 4))
    for row, number in zip(rows, numbers, strict=True):
        own = instances == number
        (left, right), (top, bottom) = (
            np.flatnonzero(own.any(axis=axis))[[0, -1]].tolist() for axis in (0, 1)
        )
        row[:] = (left + right) / 2, (top + bottom) / 2, right - left + 1, bottom - top + 1
    return packed(rows)
