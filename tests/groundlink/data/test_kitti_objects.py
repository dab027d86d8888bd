# SPDX-License-Identifier: Apache-2.0
"""A labeled camera as a folder of KITTI's object benchmark: numbers of a scene made by hand."""

import math
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from groundlink.core.frames import quaternion_from_rpy
from groundlink.data.dataset import Dataset
from groundlink.data.export import export
from groundlink.data.kitti_objects import truncation
from groundlink.messages.base import BusMessage, packed
from groundlink.messages.ground_truth import Detections2D, Detections3D, LabelTable
from groundlink.recording.metadata import TopicFacts
from groundlink.ros.cdr import CODECS, to_cdr
from groundlink.ros.types import STORE, TYPES, header

NANOS = 10**9
K = np.array([[400.0, 0.0, 319.5], [0.0, 400.0, 239.5], [0.0, 0.0, 1.0]])
SIZE = (640, 480)
OPTICAL = quaternion_from_rpy(-math.pi / 2, 0.0, -math.pi / 2)
MOUNTS = {
    "camera_optical_frame": (0.3, 0.0, 0.5, *OPTICAL),
    "lidar_link": (0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
}
PICTURES = "/camera/image_raw"
CLASSES = packed(np.array([7], np.uint16))
YAW = math.radians(40)
"""Of the object, to the left, seen from above."""


def ros(message: BusMessage) -> Any:
    return STORE.deserialize_cdr(bytes(to_cdr(message)), CODECS[type(message)].ros_type)


def picture(stamp: int) -> Any:
    pixels = np.full(SIZE[0] * SIZE[1], stamp // NANOS, np.uint8)
    encoding = ("mono8", 0, SIZE[0], pixels)
    return TYPES["sensor_msgs/msg/Image"](header(stamp, "c"), SIZE[1], SIZE[0], *encoding)


def camera_info(stamp: int, distortion: float) -> Any:
    region = TYPES["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    return TYPES["sensor_msgs/msg/CameraInfo"](
        *(header(stamp, "c"), SIZE[1], SIZE[0], "plumb_bob", np.array([distortion] + [0.0] * 4)),
        *(K.ravel(), np.eye(3).ravel(), np.zeros(12), 0, 0, region),
    )


def boxes(stamp: int) -> tuple[Any, Any]:
    """Return a box of 4 x 2 x 1.5 m, 10 m ahead and 1 m to the right, at the camera's height."""
    visible = packed(np.array([0.6]))
    object_ = (("car 1",), CLASSES, visible)
    flat = Detections2D(stamp, "c", *object_, packed(np.array([360.0, 240.0, 201.0, 61.0])))
    ahead, up = np.array([-math.sin(YAW), 0.0, math.cos(YAW)]), np.array([0.0, -1.0, 0.0])
    turn = Rotation.from_matrix(np.column_stack((ahead, np.cross(up, ahead), up))).as_quat()
    box = packed(np.array([1.0, 0.0, 10.0, *turn, 4.0, 2.0, 1.5]))
    return ros(flat), ros(Detections3D(stamp, "c", *object_, box))


def cloud(stamp: int) -> Any:
    field = TYPES["sensor_msgs/msg/PointField"]
    fields = [field(name, 4 * place, 7, 1) for place, name in enumerate("xyz")]
    point = np.array([stamp / NANOS, 0.0, 0.0], np.float32).view(np.uint8)
    return TYPES["sensor_msgs/msg/PointCloud2"](
        header(stamp, "lidar_link"), 1, 1, fields, False, 12, 12, point, True
    )


class Scene:
    """A recording of 3 pictures, and of clouds of a second each, which come at its end."""

    def __init__(self, *, distortion: float = 0.0, lidar: bool = True) -> None:
        names = LabelTable(0, "c", ("passenger car",), CLASSES)
        self.messages = [(0, f"{PICTURES}/labels/label_info", ros(names))]
        for stamp in (1_500_000_000, 2_000_000_000, 3_900_000_000):
            flat, solid = boxes(stamp)
            self.messages += [
                (stamp, PICTURES, picture(stamp)),
                (stamp, "/camera/camera_info", camera_info(stamp, distortion)),
                (stamp + 1, f"{PICTURES}/labels/boxes_3d", solid),
                (stamp + 2, f"{PICTURES}/labels/boxes_2d", flat),
            ]
        if lidar:
            starts = range(NANOS, 4 * NANOS, NANOS)
            self.messages += [(stamp + NANOS, "/points", cloud(stamp)) for stamp in starts]
        self.messages.sort(key=lambda message: message[0])
        sensor = SimpleNamespace(topic="/points", frame="lidar_link")
        self.scenario = SimpleNamespace(vehicles=[SimpleNamespace(name="rover", sensors=[sensor])])

    @property
    def topics(self) -> dict[str, TopicFacts]:
        names = {topic for _, topic, _ in self.messages}
        return {
            name: TopicFacts(type=self.ros_type(name), messages=1, first_nanos=0, last_nanos=0)
            for name in names
        }

    def ros_type(self, topic: str) -> str:
        return next(str(m.__msgtype__) for _, name, m in self.messages if name == topic)

    def sensor_frame(self, topic: str) -> tuple[str, str] | None:
        return ("rover", "camera_optical_frame") if topic == PICTURES else None

    def mount(self, vehicle: str, frame: str) -> tuple[float, ...]:
        return MOUNTS[frame]

    def interleaved(self, topics: Any, **_: Any) -> Iterator[tuple[str, int, Any]]:
        return ((name, time, message) for time, name, message in self.messages if name in topics)

    def exported(self, folder: Path) -> tuple[Path, dict[str, str]]:
        found = export(cast(Dataset, self), folder, formats=["kitti-objects"], topics=[PICTURES])
        return folder / "camera_image_raw" / "kitti-objects", found.left_out


def numbers(file: Path) -> dict[str, list[float]]:
    lines = (line.split(":") for line in file.read_text(encoding="ascii").splitlines())
    return {name: [float(number) for number in row.split()] for name, row in lines}


def test_a_folder_has_what_the_benchmark_has(tmp_path: Path) -> None:
    folder, _ = Scene().exported(tmp_path)
    files = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    suffixes = {"image_2": "png", "label_2": "txt", "calib": "txt", "velodyne": "bin"}
    assert files == {"times.txt"} | {
        f"training/{name}/00000{number}.{suffix}"
        for name, suffix in suffixes.items()
        for number in range(3)
    }
    assert (folder / "times.txt").read_text("ascii").split() == [
        *("1.500000000", "2.000000000", "3.900000000")
    ]
    for number, second in enumerate((1, 2, 3)):
        with Image.open(folder / "training" / "image_2" / f"00000{number}.png") as image:
            assert (image.size, image.getpixel((0, 0))) == (SIZE, second)
        # The cloud whose revolution the picture's stamp is in.
        scan = np.fromfile(folder / "training" / "velodyne" / f"00000{number}.bin", "<f4")
        assert scan.tolist() == [second, 0, 0, 0]


def test_a_label_is_in_the_terms_of_the_benchmark(tmp_path: Path) -> None:
    folder, _ = Scene().exported(tmp_path)
    text = (folder / "training" / "label_2" / "000000.txt").read_text("utf-8").split()
    assert text[0] == "passenger_car"
    truncated, occluded, alpha, *rest = map(float, text[1:])
    assert (truncated, occluded) == (0, 1)
    assert rest[:4] == [260, 210, 460, 270]
    assert rest[4:7] == [1.5, 2, 4]
    # On the ground, 0.75 m below the camera; y points down.
    assert rest[7:10] == [1, 0.75, 10]
    # Zero is to the right and grows clockwise, seen from above.
    assert rest[10] == pytest.approx(math.radians(-90 - 40), abs=1e-4)
    assert alpha == pytest.approx(rest[10] - math.atan2(1, 10), abs=1e-4)


def test_a_calibration_takes_points_of_the_lidar_into_the_picture(tmp_path: Path) -> None:
    folder, _ = Scene().exported(tmp_path)
    found = numbers(folder / "training" / "calib" / "000000.txt")
    into = np.array(found["Tr_velo_to_cam"]).reshape(3, 4)
    # 10 m ahead of the camera, 1 m to its right and 0.5 m above it.
    np.testing.assert_allclose(into @ (10.3, -1.0, 0.0, 1.0), (1.0, -0.5, 10.0), atol=1e-9)
    projected = np.array(found["P2"]).reshape(3, 4) @ (1.0, -0.5, 10.0, 1.0)
    np.testing.assert_allclose(projected[:2] / projected[2], (359.5, 219.5))
    lidar_from_base = np.array(found["Tr_imu_to_velo"]).reshape(3, 4)
    assert (lidar_from_base @ (0.0, 0.0, 1.0, 1.0)).tolist() == [0, 0, 0]
    assert found["R0_rect"] == np.eye(3).ravel().tolist()


def test_without_a_lidar_there_are_no_clouds(tmp_path: Path) -> None:
    folder, _ = Scene(lidar=False).exported(tmp_path)
    assert not (folder / "training" / "velodyne").exists()
    assert len([*(folder / "training" / "label_2").iterdir()]) == 3


def test_pictures_with_distortion_are_left_out(tmp_path: Path) -> None:
    folder, left_out = Scene(distortion=-0.1).exported(tmp_path)
    assert left_out == {PICTURES: "pictures of a lens with distortion"}
    assert not folder.exists()


@pytest.mark.parametrize(("x_m", "share"), [(0.0, 0.0), (-8.0, 0.5), (8.0, 0.5), (-12.0, 1.0)])
def test_truncation_is_the_share_beyond_the_edges(x_m: float, share: float) -> None:
    """A thin plate of 4 x 2 m at 10 m, where the picture is 16 m wide."""
    size = np.array([4.0, 2.0, 1e-9])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size / 2
    assert truncation(corners + np.array([x_m, 0.0, 10.0]), K, SIZE) == pytest.approx(
        share, abs=1e-6
    )


def test_a_box_around_the_camera_is_cut_off() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 5)], float)
    assert 0.9 < truncation(corners, K, SIZE) < 1
