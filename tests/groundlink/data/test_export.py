# SPDX-License-Identifier: Apache-2.0
"""A recording of every kind of sensor, exported, and compared with what independent readers say."""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import groundlink
from groundlink.core.errors import UserError
from groundlink.data.dataset import Dataset
from groundlink.data.export import ExportSummary, export
from groundlink.data.formats import FORMATS
from groundlink.data.trajectory import Trajectory
from groundlink.recording.metadata import TopicFacts
from groundlink.ros.types import TYPES, header

from .test_dataset import FILE, decoded, stamp_of, topic_of
from .test_formats import read_pcd


@pytest.fixture(scope="module")
def run() -> Iterator[Dataset]:
    with groundlink.open(FILE) as opened:
        yield opened


@pytest.fixture(scope="module")
def exported(run: Dataset, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ExportSummary]:
    out = tmp_path_factory.mktemp("exported")
    return out, export(run, out, formats=FORMATS, frames=["lidar_link"])


def contents(folder: Path) -> dict[str, bytes]:
    """Return all files of a folder."""
    files = (file for file in folder.rglob("*") if file.is_file())
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in files}


def test_every_topic_has_every_format_that_fits(exported: tuple[Path, ExportSummary]) -> None:
    out, summary = exported
    by_topic: dict[str, set[str]] = {}
    for found in summary.paths:
        assert (out / found.path).is_dir() == found.path.endswith("/")
        by_topic.setdefault(found.topic, set()).add(found.path)
    assert by_topic["/points"] == {"points/kitti/", "points/pcd/"}
    assert by_topic["/depth/image_rect_raw"] == {"depth_image_rect_raw/png/"}
    assert by_topic["/imu"] == {"imu.csv", "imu.parquet"}
    assert by_topic["/odom"] == {"odom.csv", "odom.parquet", "odom.tum", "odom/kitti/"}
    truths = {"ground_truth_odom_lidar_link.tum", "ground_truth_odom_lidar_link/kitti/"}
    assert truths < by_topic["/ground_truth/odom"]
    paths = [found.path for found in summary.paths]
    assert paths == sorted(set(paths))
    assert {name.partition("/")[0] for name in contents(out)} == {
        path.partition("/")[0] for path in paths
    }
    assert summary.left_out["/tf"] == "text or lists of messages"
    assert set(summary.left_out).isdisjoint(by_topic)
    with groundlink.open(FILE) as run:
        with_messages = {topic for topic, facts in run.topics.items() if facts.messages}
    assert {*summary.left_out, *by_topic} == with_messages


def test_trajectories_are_the_poses_of_their_topics(exported: tuple[Path, ExportSummary]) -> None:
    for topic in ("odom", "ground_truth_odom"):
        rows = np.loadtxt(exported[0] / f"{topic}.tum")
        expected = decoded(f"/{topic}".replace("truth_", "truth/"))
        poses = [message.pose.pose for message in expected]
        np.testing.assert_allclose(rows[:, 0], [stamp_of(m) / 1e9 for m in expected], rtol=1e-15)
        places = [(p.position.x, p.position.y, p.position.z) for p in poses]
        np.testing.assert_allclose(rows[:, 1:4], places, rtol=1e-8)
        turns = [(*(getattr(p.orientation, c) for c in "xyzw"),) for p in poses]
        np.testing.assert_allclose(rows[:, 4:], turns, rtol=1e-8)
        kitti = exported[0] / topic / "kitti"
        assert np.loadtxt(kitti / "poses.txt").shape == (len(expected), 12)
        assert len((kitti / "times.txt").read_text(encoding="ascii").splitlines()) == len(expected)


def test_poses_of_a_frame_are_the_true_ones(
    run: Dataset, exported: tuple[Path, ExportSummary]
) -> None:
    rows = np.loadtxt(exported[0] / "ground_truth_odom_lidar_link.tum")
    np.testing.assert_allclose(rows, run.truth(frame="lidar_link").rows, rtol=1e-8)
    assert np.linalg.norm(rows[0, 1:4] - run.truth().positions_m[0]) > 0.05


def test_scans_have_a_true_pose_each(run: Dataset, exported: tuple[Path, ExportSummary]) -> None:
    folder, expected = exported[0] / "points" / "kitti", decoded("/points")
    files = sorted((folder / "velodyne").iterdir())
    assert [file.name for file in files] == [f"{i:06d}.bin" for i in range(len(expected))]
    record = np.dtype([(name, "<f4") for name in ("x", "y", "z", "intensity")])
    for file, (_, points), message in zip(files, run.contents("/points"), expected, strict=True):
        scan = np.fromfile(file, record)
        assert len(scan) == message.width
        for name in record.names or ():
            assert scan[name].tolist() == points[name].tolist()
    times = [float(line) for line in (folder / "times.txt").read_text("ascii").splitlines()]
    assert times == [stamp_of(message) / 1e9 for message in expected]
    poses = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    truth = run.truth(frame="lidar_link").at(np.array(times))
    moved = np.linalg.norm(truth.positions_m - truth.positions_m[0], axis=1)
    np.testing.assert_allclose(np.linalg.norm(poses[:, :, 3], axis=1), moved, atol=1e-8)
    turned = np.abs(truth.orientations @ truth.orientations[0])
    np.testing.assert_allclose(
        np.trace(poses[:, :, :3], axis1=1, axis2=2), 4 * turned**2 - 1, atol=1e-8
    )
    assert turned[-1] < 0.9999


def test_clouds_and_images_are_those_of_the_messages(
    exported: tuple[Path, ExportSummary],
) -> None:
    out, _ = exported
    for number, message in enumerate(decoded("/points")):
        _, fields = read_pcd(out / "points" / "pcd" / f"{number:06d}.pcd")
        assert [*fields] == [found.name for found in message.fields]
        raw = np.frombuffer(message.data, np.uint8).reshape(message.width, message.point_step)
        for found in message.fields:
            size = fields[found.name].itemsize
            part = raw[:, found.offset : found.offset + size]
            assert fields[found.name].tobytes() == part.tobytes()
    for number, message in enumerate(decoded("/depth/image_rect_raw")):
        with Image.open(out / "depth_image_rect_raw" / "png" / f"{number:06d}.png") as image:
            assert image.mode == "I;16"
            assert np.asarray(image).tobytes() == bytes(message.data)
    stamps = [f"{stamp_of(m) / 1e9:.9f}" for m in decoded("/camera/image_raw/compressed")]
    times = out / "camera_image_raw_compressed" / "png" / "times.txt"
    assert times.read_text(encoding="ascii").split() == stamps


def test_rows_are_those_of_the_data_frame(
    run: Dataset, exported: tuple[Path, ExportSummary]
) -> None:
    for found in exported[1].paths:
        if not found.path.endswith(".csv"):
            continue
        with (exported[0] / found.path).open(newline="", encoding="utf-8") as stream:
            names, *rows = csv.reader(stream)
        frame = run.dataframe(found.topic)
        assert names == list(frame.columns)
        assert len(rows) == len(frame) == found.messages
        for name, texts in zip(names, zip(*rows, strict=True), strict=True):
            values = frame[name].to_numpy()
            if values.dtype != bool:
                np.testing.assert_array_equal(np.array(texts).astype(values.dtype), values)
    table = run.dataframe(topic_of(run, "groundlink_msgs/msg/WheelEncoders"))
    assert "ticks.front_left_wheel" in table.columns


def test_a_second_export_is_the_same(
    run: Dataset, exported: tuple[Path, ExportSummary], tmp_path: Path
) -> None:
    export(run, tmp_path, formats=FORMATS, frames=["lidar_link"])
    assert contents(tmp_path) == contents(exported[0])


def test_a_span_and_a_choice_of_topics(run: Dataset, tmp_path: Path) -> None:
    chosen = ["/odom", "/points", "/odom"]
    summary = export(
        run, tmp_path, formats=["tum", "pcd", "png"], topics=chosen, start_s=0.2, end_s=0.4
    )
    assert [found.path for found in summary.paths] == ["odom.tum", "points/pcd/"]
    seconds = np.loadtxt(tmp_path / "odom.tum")[:, 0] - run.start_nanos / 1e9
    np.testing.assert_allclose(seconds, np.arange(0.2, 0.4, 0.02), atol=1e-6)
    assert [found.messages for found in summary.paths] == [10, 2]


def test_what_cannot_be_exported_is_named(run: Dataset, tmp_path: Path) -> None:
    summary = export(run, tmp_path, formats=["csv"], topics=["/points", "/gaps/rover/imu"])
    assert summary == ExportSummary(
        [],
        {
            "/points": "no chosen format fits the type",
            "/gaps/rover/imu": "no messages in this span",
        },
    )
    with pytest.raises(UserError, match=r"no topic `/imo`; expected one of .*/imu"):
        export(run, tmp_path, formats=["csv"], topics=["/imo"])
    with pytest.raises(UserError, match=r"no frame `lidar_lnk`; did you mean `lidar_link`\?"):
        export(run, tmp_path, formats=["tum"], frames=["lidar_lnk"])
    assert contents(tmp_path) == {}


@dataclass
class Stub:
    """A recording of some messages, one every second."""

    messages: Mapping[str, list[Any]]
    truths: Mapping[str | None, Trajectory] = field(default_factory=dict)
    """True poses by frame."""

    @property
    def topics(self) -> dict[str, TopicFacts]:
        return {
            topic: TopicFacts(
                type=self.ros_type(topic), messages=len(some), first_nanos=0, last_nanos=0
            )
            for topic, some in self.messages.items()
        }

    def ros_type(self, topic: str) -> str:
        return str(self.messages[topic][0].__msgtype__)

    def sensor_frame(self, topic: str) -> tuple[str, str] | None:
        return ("rover", "lidar_link") if topic == "/points" else None

    def truth_topic(self, vehicle: str) -> str:
        return f"/{vehicle}/truth"

    def truth(self, vehicle: str, frame: str | None = None) -> Trajectory:
        assert vehicle == "rover"
        return self.truths[frame]

    def interleaved(self, topics: Any, **_: Any) -> Iterator[tuple[str, int, Any]]:
        for topic in topics:
            for second, message in enumerate(self.messages[topic]):
                yield topic, second * 10**9, message


def scan(length: int) -> Any:
    return TYPES["sensor_msgs/msg/JointState"](
        header=header(0, "base_link"),
        name=[],
        position=np.zeros(length),
        velocity=np.zeros(0),
        effort=np.zeros(0),
    )


def image(encoding: str, data: NDArray[np.uint8]) -> Any:
    return TYPES["sensor_msgs/msg/Image"](
        header=header(0, "camera"),
        height=1,
        width=2,
        encoding=encoding,
        is_bigendian=0,
        step=data.size,
        data=data,
    )


def line(*, start: float, end: float, speed_mps: float) -> Trajectory:
    """Return poses along y, one every second."""
    seconds = np.arange(start, end + 1)
    places = np.column_stack((0 * seconds, speed_mps * seconds, 0 * seconds))
    return Trajectory(seconds, places, np.tile([0.0, 0.0, 0.0, 1.0], (len(seconds), 1)))


def one_point(second: int) -> Any:
    x = TYPES["sensor_msgs/msg/PointField"](name="x", offset=0, datatype=7, count=1)
    data = np.array([second], np.float32).view(np.uint8)
    stamp = header(second * 10**9, "lidar_link")
    return TYPES["sensor_msgs/msg/PointCloud2"](stamp, 1, 1, [x], False, 4, 4, data, True)


def test_scans_with_a_true_pose_have_that_of_the_lidar(tmp_path: Path) -> None:
    truths = {
        None: line(start=1, end=4, speed_mps=5),
        "lidar_link": line(start=1, end=4, speed_mps=2),
    }
    messages = {
        "/points": [one_point(second) for second in range(7)],
        "/other": [one_point(second) for second in range(3)],
        "/rover/truth": [TYPES["nav_msgs/msg/Odometry"]],
    }
    stub = cast(Dataset, Stub(messages, truths))
    summary = export(stub, tmp_path, formats=["kitti"], topics=["/points", "/other"])
    assert [(found.path, found.messages) for found in summary.paths] == [
        ("other/kitti/", 3),
        ("points/kitti/", 4),
    ]
    folder = tmp_path / "points" / "kitti"
    times = (folder / "times.txt").read_text(encoding="ascii").split()
    assert times == [f"{second}.000000000" for second in (1, 2, 3, 4)]
    files = sorted((folder / "velodyne").iterdir())
    assert [np.fromfile(file, "<f4")[0] for file in files] == [1, 2, 3, 4]
    assert np.loadtxt(folder / "poses.txt")[:, 7].tolist() == [0, 2, 4, 6]
    assert not (tmp_path / "other" / "kitti" / "poses.txt").exists()


@pytest.mark.parametrize("second", [1, 3, 250, 251])
def test_lists_that_differ_in_length_leave_no_file(tmp_path: Path, second: int) -> None:
    joints = [scan(3)] * second + [scan(1)]
    stub = cast(Dataset, Stub({"/a/b": joints, "/a_b": [scan(3)] * 260}))
    summary = export(stub, tmp_path, formats=["csv", "parquet"])
    assert summary.left_out == {"/a/b": "lists that differ in length"}
    assert [found.path for found in summary.paths] == ["a_b_.csv", "a_b_.parquet"]
    assert set(contents(tmp_path)) == {"a_b_.csv", "a_b_.parquet"}
    assert len((tmp_path / "a_b_.csv").read_text(encoding="utf-8").splitlines()) == 261


def test_colors_are_red_green_blue_whatever_the_encoding(tmp_path: Path) -> None:
    data = np.array([1, 2, 3, 4, 5, 6], np.uint8)
    messages = {"/bgr": [image("bgr8", data)], "/odd": [image("yuv422", data)]}
    summary = export(cast(Dataset, Stub(messages)), tmp_path, formats=["png"])
    with Image.open(tmp_path / "bgr" / "png" / "000000.png") as picture:
        assert np.asarray(picture).tolist() == [[[3, 2, 1], [6, 5, 4]]]
    assert summary.left_out == {"/odd": "unknown encoding of an image: 'yuv422'"}
    assert set(contents(tmp_path)) == {"bgr/png/000000.png", "bgr/png/times.txt"}
