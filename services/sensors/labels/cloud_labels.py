# SPDX-License-Identifier: Apache-2.0
"""Labels of a LiDAR's clouds: what each point is on, and boxes around the objects with points."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from groundlink.core.frames import Floats
from groundlink.messages.base import packed
from groundlink.messages.ground_truth import LABELED_POINT, LabeledPoints, LabelTable
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.bodies import NO_BODY, body_names
from groundlink.scene.object_labels import NONE, object_labels
from groundlink.world.terrain import BODY
from services.sensors.rays.replica import Replica
from services.sensors.runtime.model import StreamMessage
from services.sensors.scanning.returns import Returns

from .boxes import ObjectBoxes


class CloudLabels:
    """Labels of the clouds of one LiDAR.

    Parameters
    ----------
    forms
        `labels` of the scenario.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        replica: Replica,
        mount: Mount,
        forms: tuple[str, ...],
    ) -> None:
        table = object_labels(scenario)
        self._replica, self._forms = replica, frozenset(forms)
        self._boxes = ObjectBoxes(table, replica, vehicle.name, (mount.xyz_m, mount.quaternion()))
        movers = [table.number_of[name] for name in replica.movers]
        static = [table.number_of_solid[solid.name] for solid in replica.static]
        terrain = [table.number_of[BODY]] if table.soils else []
        # The last entry is that of hits on no body.
        self._numbers = np.array([*movers, *static, *terrain, NONE], np.uint16)
        self._classes = np.array([NONE, *(one.class_id for one in table.objects)], np.uint16)
        self._soils = np.array(table.soils, np.uint16)
        assert len(self._numbers) == len(body_names(scenario, replica.static)) + 1

    def of_cloud(
        self,
        stamp_nanos: int,
        frame: str,
        points: NDArray[np.void],
        returns: Returns,
        poses: Floats,
    ) -> Iterator[StreamMessage]:
        """Yield the labels of a cloud.

        Parameters
        ----------
        points
            Points of the cloud, shape (N,).
        returns
            Returns that the points were made of.
        poses
            World_from_link at the stamp, shape (links, 7).
        """
        header = stamp_nanos, frame
        yield StreamMessage("label_info", LabelTable(*header, *self._boxes.class_table))
        # Points are ordered by firing, then laser, then return.
        returned = returns.returned.T
        label, body = returns.label.T[returned], returns.body.T[returned]
        bodies = self._replica.body_numbers(label, body)
        numbers = self._numbers[np.where(bodies == NO_BODY, len(self._numbers) - 1, bodies)]
        shown = np.flatnonzero(np.bincount(numbers))
        if "points" in self._forms:
            classes = self._classes[numbers]
            soil = label - len(self._replica.static)
            on_terrain = (body < 0) & (soil >= 0)
            classes[on_terrain] = self._soils[soil[on_terrain]]
            labeled = np.empty(len(points), LABELED_POINT)
            for name in points.dtype.names or ():
                labeled[name] = points[name]
            labeled["label"], labeled["instance"] = classes, numbers
            yield StreamMessage("labeled_points", LabeledPoints(*header, packed(labeled)))
            yield StreamMessage("instance_info", self._boxes.instance_table(*header, shown))
        if "boxes_3d" in self._forms:
            boxed = self._boxes.boxed(shown)
            all_seen = [1.0] * len(boxed)
            yield StreamMessage("boxes_3d", self._boxes.in_space(*header, boxed, poses, all_seen))
