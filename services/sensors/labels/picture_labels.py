# SPDX-License-Identifier: Apache-2.0
"""Labels of a camera's pictures: what each pixel shows, and boxes around the objects.

Labels are drawn like depth: without multisampling, in the middle of the exposure, behind the same
lens. Each pixel has the label of the nearest drawn pixel.
"""

from collections.abc import Iterator

import numpy as np

from groundlink.messages.base import packed
from groundlink.messages.ground_truth import Detections2D, LabelTable
from groundlink.scenario.cameras import Optics
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scene.object_labels import NONE, object_labels
from groundlink.world.terrain import BODY
from services.sensors.rendering.cameras.camera_eye import CameraEye
from services.sensors.rendering.cameras.messages import image
from services.sensors.rendering.gl.target import Frame
from services.sensors.runtime.model import StreamMessage

from .boxes import ObjectBoxes, boxes_in_picture


class PictureLabels:
    """Labels of the pictures of one camera.

    Parameters
    ----------
    camera : CameraEye
        Draws the layers `labels` and `soils`; of several eyes, the first one is labeled.
    """

    def __init__(
        self, scenario: Scenario, vehicle: Vehicle, spec: Optics, camera: CameraEye
    ) -> None:
        table = object_labels(scenario)
        drawn = camera.eye.renderer.labels
        self._camera = camera
        self._frame = vehicle.frame_prefix + spec.frame
        self._forms = frozenset(spec.labels)
        mount = spec.mount.xyz_m, spec.mount.quaternion(optical=True)
        self._boxes = ObjectBoxes(table, camera.eye.around, vehicle.name, mount)
        numbers = [table.number_of[name] for name in drawn.instances]
        classes = [
            table.classes[kind] if name == BODY else table.objects[number - 1].class_id
            for name, kind, number in zip(drawn.instances, drawn.classes, numbers, strict=True)
        ]
        # The last entry is that of the label -1.
        self._numbers = np.array([*numbers, NONE], np.uint16)
        self._classes = np.array([*classes, NONE], np.uint8)
        self._drawn = {number: label for label, number in enumerate(numbers)}

    def of_picture(self, frame: Frame, nanos: int, stamp_nanos: int) -> Iterator[StreamMessage]:
        """Yield the labels of the picture that was drawn last, `frame`.

        Parameters
        ----------
        nanos
            Sim time of the beginning of the exposure.
        """
        labels = frame.labels
        assert labels is not None
        header = stamp_nanos, self._frame
        yield StreamMessage("label_info", LabelTable(*header, *self._boxes.class_table))
        instances = self._numbers[labels]
        shown = np.flatnonzero(np.bincount(instances.ravel()))
        if "segmentation" in self._forms:
            yield StreamMessage("semantic", image(*header, "mono8", self._classes[labels]))
            yield StreamMessage("instances", image(*header, "mono16", instances))
            yield StreamMessage("instance_info", self._boxes.instance_table(*header, shown))
        if not self._forms & {"boxes_2d", "boxes_3d"}:
            return
        boxed = self._boxes.boxed(shown)
        visible = self._camera.visible_shares([self._drawn[number] for number in boxed])
        if "boxes_2d" in self._forms:
            detections = Detections2D(
                *(*header, self._boxes.names(boxed), self._boxes.classes(boxed)),
                *(packed(np.array(visible)), boxes_in_picture(instances, boxed)),
            )
            yield StreamMessage("boxes_2d", detections)
        if "boxes_3d" in self._forms:
            poses = self._camera.poses(nanos)
            yield StreamMessage("boxes_3d", self._boxes.in_space(*header, boxed, poses, visible))
