# SPDX-License-Identifier: Apache-2.0
"""Every message of a vehicle is drawn, in its place, and none ends the viewer."""

import io
import struct
from typing import Any

import numpy as np
import PIL.Image
import pytest
import rerun as rr
from msgspec.structs import replace

from groundlink.bus.core_topics import COMMAND
from groundlink.bus.topics import (
    FROM_ROS,
    GROUND_TRUTH,
    OUTPUTS,
    RELAYED,
    STREAM_TOPICS,
    TRUE_WHEELS,
)
from groundlink.core.clock import NANOS, TICK_NANOS
from groundlink.loader.additions import SpawnPlace, addition
from groundlink.messages import imagery, navigation
from groundlink.messages.base import (
    POINT,
    BusMessage,
    Command,
    Imu,
    PointCloud,
    Relayed,
    VehicleState,
    WheelEncoders,
    packed,
)
from groundlink.messages.ground_truth import (
    LABELED_POINT,
    TRUE_POINT,
    Detections2D,
    Detections3D,
    LabeledPoints,
    TruePoints,
)
from groundlink.ros.cdr import to_cdr
from groundlink.ros.streams import RosStream
from groundlink.ros.types import STORE, TYPES, header, pose
from groundlink.scenario import Scenario
from groundlink.scene.change import with_more
from services.sensors.lidar_2d.spec import Lidar2d
from services.view.draw_messages import FORMS
from services.view.drawing import MOST_POINTS, Trail
from services.view.rerun_view import RerunView

from .scenes import EPOCH, SCENARIO, WITH_CRATE, Nowhere, Remembering, state

STAMP = EPOCH + 500_000_000
EYE9, ZERO36 = packed(np.eye(3)), packed(np.zeros(36))
UP = (0.0, 0.0, 0.0, 1.0)


def picture(
    coloring: Any = "intensity", scenario: Scenario = SCENARIO
) -> tuple[RerunView, Remembering]:
    """Return a picture that has track a second of driving."""
    nowhere = Nowhere()
    it = RerunView(scenario, "run", coloring=coloring, destination=nowhere)
    it.take_states([state(tick) for tick in range(401)])
    return it, nowhere.recordings[0]


def show(it: RerunView, path: str, message: BusMessage) -> None:
    key = f"groundlink/run/{path}"
    it.take(path, RosStream(key=key, message=type(message), topic="/t", declared_hz=None), message)


def cloud(points: list[tuple[float, ...]], stamp: int = STAMP) -> PointCloud:
    return PointCloud(stamp, "lidar_link", packed(np.array(points, POINT)))


def true_points(points: list[tuple[float, ...]]) -> TruePoints:
    return TruePoints(STAMP, "lidar_link", packed(np.array(points, TRUE_POINT)))


def encoders(ticks: int, stamp: int) -> WheelEncoders:
    names = tuple(wheel.name for wheel in SCENARIO.vehicles[0].model.wheels)
    return WheelEncoders(stamp, "base_link", names, (ticks,) * 4)


def camera_info() -> imagery.CameraInfo:
    lens = packed(np.array([[400.0, 0, 2], [0, 400, 1], [0, 0, 1]]))
    return imagery.CameraInfo(
        STAMP, "cam", 2, 4, "plumb_bob", packed(np.zeros(5)), lens, EYE9, packed(np.zeros(12))
    )


def odometry() -> navigation.Odometry:
    return navigation.Odometry(
        STAMP, "odom", "base", (1, 0, 0), UP, (1, 0, 0), (0, 0, 0), ZERO36, ZERO36
    )


SCAN = (STAMP, "lidar_link", 0.0, 0.1, 0.001, 0.1, 0.1, 10.0)
ONE_OBJECT = packed(np.array([5], np.uint16)), packed(np.array([0.5]))
JPEG = memoryview(b"\xff\xd8\xff\xe0 as it is")
GRID = navigation.OccupancyGrid(
    STAMP, "world", STAMP, 0.5, 2, 1, (0, 0, 0), UP, packed(np.array([-1, 100], np.int8))
)


def relayed(ros_type: str, **fields: Any) -> Relayed:
    message = TYPES[ros_type](**fields)
    return Relayed(STAMP, ros_type, memoryview(bytes(STORE.serialize_cdr(message, ros_type))))


def plan(frame: str, *points: tuple[float, float, float]) -> Relayed:
    """Return a nav_msgs/Path, whose stamps are 0 as some planners leave them."""
    pose_stamped = TYPES["geometry_msgs/msg/PoseStamped"]
    poses = [pose_stamped(header=header(0, frame), pose=pose(point, UP)) for point in points]
    return relayed("nav_msgs/msg/Path", header=header(0, frame), poses=poses)


def filtered(frame: str, points: list[tuple[float, float, float]], *, axes: str = "xyz") -> Relayed:
    """Return a sensor_msgs/PointCloud2 of 16 bytes a point, as PCL has it."""
    data = np.zeros((len(points), 4), np.float32)
    data[:, :3] = points
    field = TYPES["sensor_msgs/msg/PointField"]
    return relayed(
        "sensor_msgs/msg/PointCloud2",
        header=header(0, frame),
        height=1,
        width=len(points),
        fields=[field(name=axis, offset=4 * i, datatype=7, count=1) for i, axis in enumerate(axes)],
        is_bigendian=False,
        point_step=16,
        row_step=16 * len(points),
        data=data.view(np.uint8).ravel(),
        is_dense=True,
    )


CASES: dict[type[BusMessage], tuple[BusMessage, str, type | None]] = {
    Command: (Command(STAMP, (1, 0, 0), (0, 0, 0)), "rover/speed/commanded", None),
    Imu: (Imu(STAMP, "imu_link", UP, (0, 0, 1), (0, 0, 9), 0, 0, 0), "rover/x/acceleration", None),
    PointCloud: (cloud([(1, 0, 0, 80, 3, 0)]), "rover/x", rr.Points3D),
    TruePoints: (true_points([(1, 0, 0, 80, 3, 0, 7)]), "rover/x", rr.Points3D),
    LabeledPoints: (
        LabeledPoints(
            STAMP, "lidar_link", packed(np.array([(1, 0, 0, 80, 3, 0, 5, 7)], LABELED_POINT))
        ),
        "rover/x",
        rr.Points3D,
    ),
    Detections2D: (
        Detections2D(STAMP, "cam", ("table_1",), *ONE_OBJECT, packed(np.ones(4))),
        "rover/x",
        rr.Boxes2D,
    ),
    Detections3D: (
        Detections3D(STAMP, "cam", ("table_1",), *ONE_OBJECT, packed(np.ones(10))),
        "rover/x",
        rr.Boxes3D,
    ),
    WheelEncoders: (encoders(5, STAMP), "rover/x", None),
    imagery.Image: (
        imagery.Image(STAMP, "cam", 2, 4, "rgb8", 16, memoryview(bytes(32))),
        "rover/x",
        rr.Image,
    ),
    imagery.CompressedImage: (
        imagery.CompressedImage(STAMP, "cam", "rgb8; jpeg compressed bgr8", JPEG),
        "rover/x",
        rr.EncodedImage,
    ),
    imagery.CameraInfo: (camera_info(), "rover/x", rr.Pinhole),
    imagery.LaserScan: (
        imagery.LaserScan(*SCAN, packed(np.array([1, np.inf], np.float32)), memoryview(b"")),
        "rover/x",
        rr.Points3D,
    ),
    imagery.RadarDetections: (
        imagery.RadarDetections(
            STAMP, "front", packed(np.array([(9, 1, 0, -3, 5, 20)], imagery.RADAR_POINT))
        ),
        "rover/x",
        rr.Points3D,
    ),
    imagery.Range: (
        imagery.Range(STAMP, "front", "ultrasound", 0.5, 0.1, 4.0, float("inf"), 0.0),
        "rover/x",
        rr.Arrows3D,
    ),
    navigation.PoseStamped: (
        navigation.PoseStamped(STAMP, "map", (0, 0, 0), UP),
        "rover/x",
        rr.LineStrips3D,
    ),
    navigation.Odometry: (odometry(), "rover/x", rr.LineStrips3D),
    navigation.OccupancyGrid: (GRID, "rover/x", rr.GridMap),
    navigation.Transforms: (
        navigation.Transforms((navigation.Transform(STAMP, "base_link", "arm", (0, 0, 1), UP),)),
        "tf/arm",
        rr.Transform3D,
    ),
    navigation.JointState: (
        navigation.JointState(STAMP, "", ("a",), packed(np.ones(1)), *(memoryview(b""),) * 2),
        "rover/x/positions",
        None,
    ),
    navigation.NavSatFix: (
        navigation.NavSatFix(STAMP, "gnss", 0, 1, 50.0, 14.4, 200.0, EYE9, 2),
        "rover/x",
        rr.GeoPoints,
    ),
    Relayed: (plan("world", (0, 0, 0), (1, 0, 0)), "rover/x", rr.LineStrips3D),
}
"""A message of each kind, where something of it is drawn, and as what; None is a plot."""


def test_all_that_ros_sees_of_a_vehicle_is_drawn() -> None:
    truths = [GROUND_TRUTH, TRUE_WHEELS, OUTPUTS["lidar"]["truth"]]
    labels = [OUTPUTS["lidar"]["labeled_points"], OUTPUTS["camera"]["boxes_2d"]]
    labels.append(OUTPUTS["camera"]["boxes_3d"])
    rows = [COMMAND, *truths, *labels, *STREAM_TOPICS.values(), *FROM_ROS.values(), RELAYED]
    assert {row.message for row in rows} == set(FORMS) == set(CASES)


@pytest.mark.parametrize("kind", CASES, ids=lambda kind: kind.__name__)
def test_each_message_is_drawn(kind: type[BusMessage]) -> None:
    message, path, drawn = CASES[kind]
    it, recording = picture()
    if kind is WheelEncoders:
        show(it, "rover/x", encoders(0, STAMP - 20_000_000))
    show(it, "rover/x", message)
    it.drawing.plots.flush()
    assert it.drawing.not_drawn == 0
    if drawn is None:
        assert recording.columns[path] == 1
    else:
        assert any(isinstance(what, drawn) for what in recording.logged[path])


def test_a_failed_distance_and_a_lost_fix_are_not_drawn() -> None:
    it, recording = picture()
    nan = float("nan")
    show(it, "rover/x", imagery.Range(STAMP, "front", "ultrasound", 0.5, 0.1, 4.0, nan, 0.0))
    show(it, "rover/y", navigation.NavSatFix(STAMP, "gnss", -1, 1, nan, nan, nan, EYE9, 0))
    it.drawing.plots.flush()
    assert it.drawing.not_drawn == 0
    assert not {"rover/x", "rover/y"} & recording.logged.keys()
    assert not any(path.startswith(("rover/x", "rover/y")) for path in recording.columns)


def test_a_jpeg_goes_as_it_is() -> None:
    it, recording = picture()
    show(it, "rover/x", CASES[imagery.CompressedImage][0])
    (image,) = (w for w in recording.logged["rover/x"] if isinstance(w, rr.EncodedImage))
    assert image.blob is not None
    assert bytes(image.blob.as_arrow_array()[0].as_py()) == bytes(JPEG)


def test_header_marks_compressed_depth_in_meters() -> None:
    """The PNG holds A / depth + B; here 1, 2 and 4 m, and none."""
    stored = np.array([[9001, 4001, 1501, 0]], np.uint16)
    file = io.BytesIO()
    PIL.Image.fromarray(stored).save(file, "png")
    data = struct.pack("<iff", 1, 10_000.0, -999.0) + file.getvalue()
    it, recording = picture()
    format = "32FC1; compressedDepth png"
    show(it, "rover/x", imagery.CompressedImage(STAMP, "cam", format, memoryview(data)))
    (depth,) = (w for w in recording.logged["rover/x"] if isinstance(w, rr.DepthImage))
    meters = np.frombuffer(bytes(depth.buffer.as_arrow_array()[0].as_py()), np.float32)
    assert meters == pytest.approx([1.0, 2.0, 4.0, np.nan], nan_ok=True)
    assert depth.meter.as_arrow_array().to_pylist() == [1.0]


def test_compressed_depth_in_millimeters_goes_as_it_is() -> None:
    data = memoryview(struct.pack("<iff", 1, 0.0, 0.0) + b"a PNG")
    it, recording = picture()
    show(it, "rover/x", imagery.CompressedImage(STAMP, "cam", "16UC1; compressedDepth png", data))
    (depth,) = (w for w in recording.logged["rover/x"] if isinstance(w, rr.EncodedDepthImage))
    assert bytes(depth.blob.as_arrow_array()[0].as_py()) == b"a PNG"
    assert depth.meter.as_arrow_array().to_pylist() == [1000.0]


def test_a_cloud_is_placed_point_by_point() -> None:
    """The rover drives 1 m/s; its LiDAR is 0.65 m above the base. The same spot, 0.1 s apart."""
    it, recording = picture()
    show(it, "rover/lidar", cloud([(2.0, 0, 0, 50, 0, 0.0), (1.9, 0, 0, 50, 15, 0.1)]))
    (points,) = recording.logged["rover/lidar"]
    placed = np.array(points.positions.as_arrow_array().to_pylist())
    assert placed == pytest.approx(np.array([[2.5, 0, 0.65]] * 2), abs=1e-5)


@pytest.mark.parametrize(("block_deg", "drawn"), [(0.0, 3), (120.0, 1)])
def test_blocks_of_a_scan_are_drawn_as_one(block_deg: float, drawn: int) -> None:
    place = {"name": "scanner", "topic": "/scan", "frame": "scan_link"}
    scanner = Lidar2d(**place, block_deg=block_deg)  # type: ignore[arg-type]
    rover = replace(SCENARIO.vehicles[0], sensors=(scanner,))
    it, recording = picture(scenario=replace(SCENARIO, vehicles=(rover,)))
    distances = packed(np.array([1, np.inf, 2], np.float32))
    for part in range(3):
        stamp, _, angle, *rest = SCAN
        scan = (stamp + part, "scan_link", angle + part, *rest, distances, memoryview(b""))
        show(it, "rover/scanner", imagery.LaserScan(*scan))
    points = recording.logged["rover/scanner"]
    assert len(points) == drawn
    assert sum(len(each.positions.as_arrow_array()) for each in points) == 6


def test_the_truth_is_of_one_instant_and_colored_by_body() -> None:
    it, recording = picture()
    track = [(2.0, 0, 0, 50, 0, 0.0, 7), (2.0, 0, 0, 50, 9, 0.1, 7), (2.0, 0, 0, 50, 0, 0.0, 8)]
    show(it, "rover/lidar/truth", true_points(track))
    (points,) = recording.logged["rover/lidar/truth"]
    placed = np.array(points.positions.as_arrow_array().to_pylist())
    assert placed == pytest.approx(np.tile(placed[0], (3, 1)))
    first, same, other = points.colors.as_arrow_array().to_pylist()
    assert first == same != other


@pytest.mark.parametrize(("coloring", "differ"), [("intensity", False), ("ring", True)])
def test_colors_are_by_intensity_or_by_ring(coloring: str, differ: bool) -> None:
    it, recording = picture(coloring)
    show(it, "rover/lidar", cloud([(2.0, 0, 0, 50, 0, 0.0), (2.0, 0, 0, 50, 15, 0.0)]))
    (points,) = recording.logged["rover/lidar"]
    first, second = points.colors.as_arrow_array().to_pylist()
    assert (first != second) == differ


def test_a_cloud_from_before_the_first_state_is_counted() -> None:
    it, recording = picture()
    show(it, "rover/lidar", cloud([(1, 0, 0, 9, 0, 0)], stamp=EPOCH - 1))
    assert it.drawing.not_drawn == 1
    assert "rover/lidar" not in recording.logged


@pytest.mark.parametrize(
    "message",
    [
        imagery.Image(STAMP, "cam", 1, 1, "bayer_rggb8", 1, memoryview(b"x")),
        imagery.CompressedImage(STAMP, "cam", "h264", memoryview(b"x")),
        imagery.CompressedImage(STAMP, "cam", "32FC1; compressedDepth png", memoryview(b"x")),
        imagery.CompressedImage(STAMP, "cam", "32FC1; compressedDepth png", memoryview(bytes(99))),
        PointCloud(STAMP, "nowhere", packed(np.zeros(1, POINT))),
    ],
    ids=["bayer", "h264", "no header", "no PNG", "unknown frame"],
)
def test_undrawable_messages_are_counted(message: BusMessage) -> None:
    it, _ = picture()
    show(it, "rover/x", message)
    assert it.drawing.not_drawn == 1


@pytest.mark.parametrize(
    ("encoding", "dtype", "channels"),
    [("mono8", "u1", 1), ("bgra8", "u1", 4), ("mono16", "<u2", 1), ("32FC1", "<f4", 1)],
)
def test_rows_lose_their_padding(encoding: str, dtype: str, channels: int) -> None:
    pixels = np.arange(2 * 3 * channels).astype(dtype).reshape(2, -1)
    padded = np.concatenate([pixels.view(np.uint8), np.full((2, 5), 255, np.uint8)], axis=1)
    it, recording = picture()
    message = imagery.Image(STAMP, "cam", 2, 3, encoding, padded.shape[1], packed(padded))
    show(it, "rover/x", message)
    drawn = recording.logged["rover/x"][-1]
    assert bytes(drawn.buffer.as_arrow_array()[0].as_py()) == pixels.tobytes()


def test_the_stack_begins_on_the_truth_and_may_leave_it() -> None:
    """The stack calls its start the origin; the rover was at x = 0.5 m then."""
    it, recording = picture()
    show(it, "rover/from_ros/map", GRID_OF_STACK)
    assert "rover/from_ros/map" not in recording.logged
    show(it, "rover/from_ros/pose", navigation.PoseStamped(STAMP, "map", (0, 0, 0), UP))
    (frame,) = recording.logged["tf/rover/from_ros"]
    assert frame.translation.as_arrow_array().to_pylist() == [pytest.approx([0.5, 0, 0])]
    assert any(isinstance(what, rr.GridMap) for what in recording.logged["rover/from_ros/map"])
    show(it, "rover/from_ros/pose", navigation.PoseStamped(STAMP + 1, "map", (3, 1, 0), UP))
    assert len(recording.logged["tf/rover/from_ros"]) == 1


GRID_OF_STACK = navigation.OccupancyGrid(
    STAMP, "map", STAMP, 0.5, 2, 1, (0, 0, 0), UP, packed(np.array([0, 100], np.int8))
)


def test_a_plan_lies_in_the_frame_of_the_stack_and_a_cloud_in_the_sensors() -> None:
    it, recording = picture()
    path = "rover/from_ros/topics/plan"
    show(it, path, plan("map", (0, 0, 0), (1, 2, 0)))
    assert it.drawing.not_drawn == 1, "where the stack's map lies is not known yet"
    show(it, "rover/from_ros/pose", navigation.PoseStamped(STAMP, "map", (0, 0, 0), UP))
    show(it, path, plan("map", (0, 0, 0), (1, 2, 0)))
    frame, line = recording.logged[path]
    assert frame.frame.as_arrow_array().to_pylist() == ["rover/from_ros"]
    assert line.strips.as_arrow_array().to_pylist() == [[[0, 0, 0], [1, 2, 0]]]
    nan = float("nan")
    show(it, "rover/y", filtered("lidar_link", [(1, 2, 3), (nan, 0, 0)]))
    frame, points = recording.logged["rover/y"]
    assert frame.frame.as_arrow_array().to_pylist() == ["lidar_link"]
    assert points.positions.as_arrow_array().to_pylist() == [[1, 2, 3]]
    assert it.drawing.not_drawn == 1


def test_other_relayed_messages_are_drawn_or_counted() -> None:
    it, recording = picture()
    costmap = memoryview(bytes(to_cdr(GRID)))
    show(it, "rover/x", Relayed(STAMP, "nav_msgs/msg/OccupancyGrid", costmap))
    assert any(isinstance(what, rr.GridMap) for what in recording.logged["rover/x"])
    show(it, "rover/y", relayed("std_msgs/msg/String", data="hello"))
    show(it, "rover/z", filtered("lidar_link", [(1, 2, 3)], axes="abc"))
    assert it.drawing.not_drawn == 2


def test_foreign_stamps_are_drawn_at_the_current_time() -> None:
    """A node that does not use sim time, or stamps nothing, stretches no time line."""
    it, _ = picture()
    newest = it.drawing.now_nanos
    assert newest == 400 * TICK_NANOS
    assert it.drawing.sim_nanos(EPOCH + newest // 2) == newest // 2
    assert it.drawing.sim_nanos(EPOCH + newest + NANOS) == newest + NANOS
    for stamp in (0, EPOCH - 1, EPOCH + newest + 3600 * NANOS):
        assert it.drawing.sim_nanos(stamp) == newest


def test_a_new_episode_gets_a_recording_of_its_own() -> None:
    nowhere = Nowhere()
    it = RerunView(SCENARIO, "run", coloring="intensity", destination=nowhere)
    it.take_states([state(0), state(1)])
    it.take_states([state(0, epoch=EPOCH + 10**10)])
    assert len(nowhere.recordings) == 2
    show(it, "rover/lidar", cloud([(1, 0, 0, 9, 0, 0)]))
    assert it.drawing.not_drawn == 1


def test_a_vehicle_that_moves_at_400_hz_is_drawn_at_30() -> None:
    it, recording = picture()
    before = len(recording.logged["tf/base_link"])
    for tick in range(401, 801):
        it.take_states([state(tick)])
    assert 25 <= len(recording.logged["tf/base_link"]) - before <= 45


def test_a_state_of_other_vehicles_draws_nothing() -> None:
    it, _ = picture()
    other = state(402)
    vehicle: VehicleState = other.vehicles["rover"]
    other.vehicles.clear()
    other.vehicles["stranger"] = vehicle
    it.take_states([other])


def test_a_trail_is_bounded_and_keeps_its_ends() -> None:
    trail = Trail(0.01)
    for i in range(20_000):
        trail.add((i * 0.02, 0.0, 0.0))
    assert len(trail.points) <= MOST_POINTS
    assert trail.points[0] == (0.0, 0.0, 0.0)
    assert trail.points[-1][0] > 0.99 * 20_000 * 0.02


def test_actors_are_drawn_at_their_state() -> None:
    nowhere = Nowhere()
    it = RerunView(WITH_CRATE, "run", coloring="intensity", destination=nowhere)
    it.take_states([replace(state(0), actors=packed(np.array([1.0, 2.0, 0.5, *UP])))])
    (recording,) = nowhere.recordings
    assert any(isinstance(what, rr.Mesh3D) for what in recording.logged["actors/crate"])
    (moved,) = recording.logged["tf/crate"]
    assert moved.translation.as_arrow_array().to_pylist() == [[1.0, 2.0, 0.5]]


def test_a_changed_world_gets_a_recording_of_its_own() -> None:
    nowhere = Nowhere()
    it = RerunView(SCENARIO, "run", coloring="intensity", destination=nowhere)
    it.take_states([state(0)])
    _, more = addition("crate", at=SpawnPlace(1.0, 0.0), name=None, taken=(), ground=None)
    it.change(with_more(SCENARIO, more, (), seconds=0.0))
    it.take_states([replace(state(40), actors=packed(np.array([1.0, 0.0, 0.0, *UP])))])
    first, second = nowhere.recordings
    assert "actors/crate" not in first.logged
    assert second.logged["actors/crate"]
    assert second.logged["tf/crate"]
