# SPDX-License-Identifier: Apache-2.0
"""A labeled camera and the LiDAR of its vehicle as a folder of the KITTI object benchmark.

Format: Geiger, Lenz and Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark
suite", CVPR 2012, with the readme of its object development kit.
"""

import math
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from groundlink.core.frames import Floats, transform
from groundlink.ros.types import nanos, xyz, xyzw
from groundlink.scenario.cameras import info_beside

from .dataset import Dataset
from .formats import write_png, write_times, write_velodyne
from .ros_arrays import CLOUDS, IMAGES, content
from .topic_export import TopicExport, UnsuitableMessages

_OCCLUDED = ((0.9, 0), (0.5, 1), (0.0, 2))
"""Least visible share and KITTI's state: fully visible, partly occluded, largely occluded."""

_PARTS = ("picture", "CameraInfo", "Detection2DArray", "Detection3DArray")
"""What a picture is written from."""

_NEAREST_M = 0.01
"""Depth at which boxes are cut off."""

_CLOUDS_KEPT = 16
"""A picture comes out of its exposure, its drawing and its compression in less time than these."""

_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_EDGES = np.array([(a, a | bit) for a in range(8) for bit in (1, 2, 4) if not a & bit])


class KittiObjects(TopicExport):
    """Pictures, calibration, labels, and clouds of the vehicle's first LiDAR, by number.

    The cloud of a picture is the one whose revolution its stamp is in.
    """

    format, ending = "kitti-objects", "/kitti-objects/"

    def __init__(self, dataset: Dataset, topic: str, stem: Path) -> None:
        super().__init__(dataset, topic, stem)
        self._beside = _topics_beside(topic)
        sensor = dataset.sensor_frame(topic)
        assert sensor is not None
        vehicle, camera = sensor
        lidars = (
            sensor
            for sensor in next(v for v in dataset.scenario.vehicles if v.name == vehicle).sensors
            if sensor.topic in dataset.topics and dataset.ros_type(sensor.topic) in CLOUDS
        )
        self._lidar = next(lidars, None)
        frames = camera, self._lidar.frame if self._lidar else None
        base_from_camera, base_from_lidar = (
            np.eye(4) if frame is None else _transform(dataset.mount(vehicle, frame))
            for frame in frames
        )
        self._transforms = {
            "Tr_velo_to_cam": np.linalg.inv(base_from_camera) @ base_from_lidar,
            "Tr_imu_to_velo": np.linalg.inv(base_from_lidar),
        }
        self._classes: dict[str, str] = {}
        self._pending: dict[int, dict[str, Any]] = {}
        """By stamp and type, the messages of pictures that are not written yet."""

        self._clouds: deque[Any] = deque(maxlen=_CLOUDS_KEPT)
        self._stamps: list[int] = []

    @property
    def inputs(self) -> tuple[str, ...]:
        """The pictures, what belongs to them, and the clouds."""
        lidar = [self._lidar.topic] if self._lidar else []
        return (self.topic, *self._beside, *lidar)

    @staticmethod
    def takes(dataset: Dataset, topic: str) -> bool:
        """Return whether a topic has pictures with boxes."""
        return dataset.ros_type(topic) in IMAGES and all(
            beside in dataset.topics for beside in _topics_beside(topic)
        )

    def add(self, time_nanos: int, message: Any) -> None:
        """Write the pictures that are complete with this message."""
        kind = message.__msgtype__
        if kind in CLOUDS:
            self._clouds.append(message)
        elif kind == "vision_msgs/msg/LabelInfo":
            self._classes = {str(row.class_id): row.class_name for row in message.class_map}
        else:
            part = "picture" if kind in IMAGES else kind.rpartition("/")[2]
            self._pending.setdefault(nanos(message.header.stamp), {})[part] = message
        newest = nanos(self._clouds[-1].header.stamp) if self._clouds else 0
        self._write_before(newest if self._lidar else math.inf)

    def close(self) -> None:
        """Write the last pictures, and the stamps."""
        self._write_before(math.inf)
        write_times(self.path / "times.txt", self._stamps)

    def _write_before(self, end: float) -> None:
        """Write the complete pictures with a stamp before `end`, in nanoseconds."""
        for stamp, found in sorted(self._pending.items()):
            if stamp >= end or len(found) < len(_PARTS):
                continue
            del self._pending[stamp]
            clouds = [cloud for cloud in self._clouds if nanos(cloud.header.stamp) <= stamp]
            if clouds or self._lidar is None:
                picture, info, flat, solid = (found[part] for part in _PARTS)
                self._write(picture, info, flat, solid, clouds[-1:])
                self._stamps.append(stamp)
                self.messages += 1

    def _write(self, picture: Any, info: Any, flat: Any, solid: Any, clouds: list[Any]) -> None:
        if any(info.d):
            raise UnsuitableMessages("pictures of a lens with distortion")
        intrinsics = np.asarray(info.k).reshape(3, 3)
        size = info.width, info.height
        in_picture = {found.id: found for found in flat.detections}
        lines = [
            self._label(in_picture[box.id], box.bbox, intrinsics, size)
            for box in solid.detections
            if box.id in in_picture
        ]
        projection = np.hstack((intrinsics, np.zeros((3, 1))))
        calibration = {
            **{f"P{camera}": projection for camera in range(4)},
            "R0_rect": np.eye(3),
            **{name: matrix[:3] for name, matrix in self._transforms.items()},
        }
        pixels = content(picture)
        assert pixels is not None
        write_png(self._file("image_2", ".png"), pixels)
        self._file("label_2", ".txt").write_text("".join(lines), encoding="utf-8")
        self._file("calib", ".txt").write_text(
            "".join(
                f"{name}: {' '.join(f'{number:.12e}' for number in matrix.flat)}\n"
                for name, matrix in calibration.items()
            ),
            encoding="ascii",
        )
        for cloud in clouds:
            points = content(cloud)
            assert points is not None
            write_velodyne(self._file("velodyne", ".bin"), points)

    def _label(self, flat: Any, box: Any, intrinsics: Floats, size: tuple[int, int]) -> str:
        """Return the line of an object.

        Its box stands on its lowest face, and is turned about the y axis of the camera alone, as
        KITTI has it.
        """
        best = flat.results[0].hypothesis
        middle = flat.bbox.center.position
        half = (flat.bbox.size_x - 1) / 2, (flat.bbox.size_y - 1) / 2
        length, width, height = xyz(box.size)
        camera_from_box = transform(xyz(box.center.position), xyzw(box.center.orientation))
        x, y, z = camera_from_box[:3, 3] - camera_from_box[:3, 2] * height / 2
        turned = math.atan2(-camera_from_box[2, 0], camera_from_box[0, 0])
        numbers = (
            *(math.remainder(turned - math.atan2(x, z), 2 * math.pi),),
            *(middle.x - half[0], middle.y - half[1], middle.x + half[0], middle.y + half[1]),
            *(height, width, length, x, y, z, turned),
        )
        corners = _CORNERS * (length, width, height) @ camera_from_box[:3, :3].T
        truncated = truncation(corners + camera_from_box[:3, 3], intrinsics, size)
        name = self._classes[best.class_id].replace(" ", "_")
        occluded = next(state for least, state in _OCCLUDED if best.score >= least)
        values = " ".join(f"{number:.4f}" for number in numbers)
        return f"{name} {truncated:.4f} {occluded} {values}\n"

    def _file(self, folder: str, suffix: str) -> Path:
        path = self.path / "training" / folder / f"{self.messages:06d}{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def truncation(corners: Floats, intrinsics: Floats, size: tuple[int, int]) -> float:
    """Return the share of a box's picture that is beyond the edges of the image, 0..1.

    Parameters
    ----------
    corners
        Corners of the box in the optical frame in meters, shape (8, 3), those along z first.
    intrinsics
        Camera matrix, shape (3, 3).
    size
        Width and height of the image in pixels.
    """
    first, second = corners[_EDGES[:, 0]], corners[_EDGES[:, 1]]
    seen = (first[:, 2] > _NEAREST_M) | (second[:, 2] > _NEAREST_M)
    first, second = first[seen], second[seen]
    ends = []
    for end, other in ((first, second), (second, first)):
        depth = other[:, 2] - end[:, 2]
        share = np.where(
            end[:, 2] < _NEAREST_M, (_NEAREST_M - end[:, 2]) / np.where(depth, depth, 1), 0
        )
        ends.append(end + share[:, None] * (other - end))
    drawn = np.concatenate(ends) @ intrinsics.T
    pixels = drawn[:, :2] / drawn[:, 2:]
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    inside = np.clip(high, -0.5, np.array(size) - 0.5) - np.clip(low, -0.5, np.array(size) - 0.5)
    return float(1 - inside.prod() / (high - low).prod())


def _topics_beside(topic: str) -> tuple[str, ...]:
    """Return the topics that belong to pictures: CameraInfo and labels."""
    raw = topic.removesuffix("/compressed")
    labels = (f"{raw}/labels/{stream}" for stream in ("label_info", "boxes_2d", "boxes_3d"))
    return (info_beside(raw), *labels)


def _transform(mount: tuple[float, ...]) -> Floats:
    """Return the matrix of x, y, z, qx, qy, qz, qw."""
    return transform(mount[:3], mount[3:])
