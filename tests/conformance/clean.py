# SPDX-License-Identifier: Apache-2.0
"""A clean recording, made of numbers: a vehicle drives a curve among pillars for eight seconds."""

from collections.abc import Iterator
from types import SimpleNamespace as Message
from typing import Any

import numpy as np

from sensor_conformance.sources.source import Received, SourceTopic

from . import clean_packets
from .clean_packets import EPOCH, received

DURATION = 8.0
SPEED = 2.0
ROOM = 22.0
"""Half the width of a square room."""
PILLARS = np.random.default_rng(5).uniform(-18, 18, (14, 2))
GRID = np.linspace(-0.1, DURATION + 0.2, 8301)

Messages = dict[SourceTopic, list[Received]]


def speed(t: Any) -> np.ndarray:
    """Return m/s: the vehicle stands at first."""
    return SPEED * np.clip((t - 2.0) / 0.3, 0, 1)


def yaw_rate(t: Any) -> np.ndarray:
    return (0.25 + 0.5 * np.sin(2 * np.pi * (t - 2) / 3)) * speed(t) / SPEED


STEP = float(GRID[1] - GRID[0])
YAW = np.cumsum(yaw_rate(GRID)) * STEP
X = np.cumsum(speed(GRID) * np.cos(YAW)) * STEP - 4
Y = np.cumsum(speed(GRID) * np.sin(YAW)) * STEP - 6
PATH = np.cumsum(speed(GRID)) * STEP


def pose(t: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.interp(t, GRID, X), np.interp(t, GRID, Y), np.interp(t, GRID, YAW)


def ranges(t: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Return the distance of walls and pillars from the vehicle at a time, in the horizon."""
    x, y, yaw = pose(t)
    dx, dy = np.cos(yaw + azimuth), np.sin(yaw + azimuth)
    with np.errstate(divide="ignore"):
        walls = np.minimum((np.sign(dx) * ROOM - x) / dx, (np.sign(dy) * ROOM - y) / dy)
    best = walls
    for px, py in PILLARS:
        along = (px - x) * dx + (py - y) * dy
        off = np.abs((px - x) * dy - (py - y) * dx)
        near = along - np.sqrt(np.maximum(0.36 - off**2, 0))
        best = np.where((off < 0.6) & (near > 0.3), np.minimum(best, near), best)
    return best


def stamp(nanoseconds: int) -> Message:
    return Message(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def header(nanoseconds: int, frame: str) -> Message:
    return Message(stamp=stamp(nanoseconds), frame_id=frame)


def vector(x: float, y: float, z: float) -> Message:
    return Message(x=float(x), y=float(y), z=float(z))


def turned(yaw: float) -> Message:
    return Message(x=0.0, y=0.0, z=float(np.sin(yaw / 2)), w=float(np.cos(yaw / 2)))


def times(rate: float) -> Iterator[tuple[int, float]]:
    for index in range(int(DURATION * rate)):
        yield EPOCH + round(index / rate * 1e9), index / rate


def imu() -> list[Received]:
    noise = np.random.default_rng(2)
    rows = []
    for at, t in times(100):
        rate = float(yaw_rate(t))
        gyro = noise.normal((0, 0, rate), 0.003)
        force = noise.normal((0, speed(t) * rate, 9.81), 0.02)
        rows.append(
            (
                at,
                Message(
                    header=header(at, "imu_link"),
                    orientation=turned(float(pose(t)[2])),
                    orientation_covariance=np.eye(3).reshape(-1) * 1e-4,
                    angular_velocity=vector(*gyro),
                    angular_velocity_covariance=np.eye(3).reshape(-1) * 0.003**2,
                    linear_acceleration=vector(*force),
                    linear_acceleration_covariance=np.eye(3).reshape(-1) * 0.02**2,
                ),
            )
        )
    return received(rows)


def odometry() -> list[Received]:
    rows = []
    for at, t in times(50):
        x, y, yaw = pose(t)
        rate = float(yaw_rate(t))
        place = Message(position=vector(float(x), float(y), 0), orientation=turned(float(yaw)))
        motion = Message(linear=vector(float(speed(t)), 0, 0), angular=vector(0, 0, rate))
        rows.append(
            (
                at,
                Message(
                    header=header(at, "odom"),
                    child_frame_id="base_link",
                    pose=Message(pose=place, covariance=np.eye(6).reshape(-1) * 1e-3),
                    twist=Message(twist=motion, covariance=np.eye(6).reshape(-1) * 1e-3),
                ),
            )
        )
    return received(rows)


def transform(at: int, parent: str, child: str, place: Message, rotation: Message) -> Message:
    return Message(
        header=header(at, parent),
        child_frame_id=child,
        transform=Message(translation=place, rotation=rotation),
    )


def tf() -> list[Received]:
    rows = []
    for at, t in times(50):
        x, y, yaw = pose(t)
        place = vector(float(x), float(y), 0)
        one = transform(at, "odom", "base_link", place, turned(float(yaw)))
        rows.append((at, Message(transforms=[one])))
    return received(rows)


def tf_static() -> list[Received]:
    level = turned(0.0)
    optical = Message(x=-0.5, y=0.5, z=-0.5, w=0.5)
    mounts = [
        transform(EPOCH, "base_link", "imu_link", vector(0, 0, 0.1), level),
        transform(EPOCH, "base_link", "lidar_link", vector(0, 0, 0.5), level),
        transform(EPOCH, "base_link", "gnss_link", vector(0, 0, 0.8), level),
        transform(EPOCH, "base_link", "camera_link", vector(0.2, 0, 0.3), level),
        transform(EPOCH, "camera_link", "camera_optical_frame", vector(0, 0, 0), optical),
    ]
    return received([(EPOCH, Message(transforms=mounts))])


def fix() -> list[Received]:
    noise = np.random.default_rng(3)
    rows = []
    for at, t in times(5):
        x, y, _ = pose(t)
        east, north = np.cos(0.6) * x - np.sin(0.6) * y, np.sin(0.6) * x + np.cos(0.6) * y
        east, north = noise.normal((east, north), 0.05)
        rows.append(
            (
                at,
                Message(
                    header=header(at, "gnss_link"),
                    status=Message(status=0, service=1),
                    latitude=48.0 + north / 111_320,
                    longitude=11.0 + east / (111_320 * np.cos(np.radians(48.0))),
                    altitude=500 + float(noise.normal(0, 0.1)),
                    position_covariance=np.eye(3).reshape(-1) * 0.0025,
                    position_covariance_type=2,
                ),
            )
        )
    return received(rows)


def joints() -> list[Received]:
    rows = []
    for at, t in times(50):
        angles = [float(np.interp(t, GRID, PATH)) / 0.1] * 2
        speeds = [float(speed(t)) / 0.1] * 2
        one = Message(header=header(at, ""), name=["left", "right"], position=angles)
        one.velocity, one.effort = speeds, []
        rows.append((at, one))
    return received(rows)


def scan() -> list[Received]:
    noise = np.random.default_rng(4)
    rows = []
    azimuth = np.radians(np.arange(-180, 180))
    for at, t in times(10):
        found = ranges(t + np.arange(360) * 0.1 / 360, azimuth)
        found = np.round(noise.normal(found, 0.01), 3)
        rows.append(
            (
                at,
                Message(
                    header=header(at, "lidar_link"),
                    angle_min=-np.pi,
                    angle_max=np.radians(179),
                    angle_increment=np.radians(1),
                    time_increment=0.1 / 360,
                    scan_time=0.1,
                    range_min=0.1,
                    range_max=30.0,
                    ranges=np.where(found < 30, found, np.inf).astype(np.float32),
                    intensities=np.zeros(0, np.float32),
                ),
            )
        )
    return received(rows)


POINT = np.dtype(
    [("x", "f4"), ("y", "f4"), ("z", "f4"), ("intensity", "f4"), ("ring", "u2"), ("time", "f4")]
)
NUMBERS = {"f4": 7, "u2": 4, "u1": 2}


def point_cloud(at: int, points: np.ndarray) -> Message:
    kind = points.dtype
    fields = [
        Message(
            name=name, offset=kind.fields[name][1], datatype=NUMBERS[kind[name].str[1:]], count=1
        )
        for name in kind.names
    ]
    return Message(
        header=header(at, "lidar_link"),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=kind.itemsize,
        row_step=kind.itemsize * len(points),
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def cloud() -> list[Received]:
    noise = np.random.default_rng(6)
    elevations = np.radians(np.linspace(-6, 8, 8))
    columns = np.arange(480)
    azimuth, late = np.radians(columns * 0.75 - 180), columns * 0.1 / 480
    rows = []
    for at, t in times(10):
        flat = ranges(t + late, azimuth)[:, None] / np.cos(elevations)[None, :]
        distance = noise.normal(flat, 0.01)
        points = np.zeros(distance.shape, POINT)
        level = distance * np.cos(elevations)
        points["x"], points["y"] = (
            level * np.cos(azimuth)[:, None],
            level * np.sin(azimuth)[:, None],
        )
        points["z"] = distance * np.sin(elevations)
        points["intensity"] = np.round(noise.uniform(5, 100, distance.shape))
        points["ring"] = np.arange(8)
        points["time"] = late[:, None]
        rows.append((at, point_cloud(at, points.reshape(-1))))
    return received(rows)


WIDTH, HEIGHT, FOCAL = 160, 60, 120.0


def image() -> list[Received]:
    noise = np.random.default_rng(7)
    levels = noise.uniform(20, 230, 400)
    across = np.arctan((np.arange(WIDTH) - WIDTH / 2) / FOCAL)
    shade = np.linspace(1, 0.7, HEIGHT)[:, None]
    rows = []
    for at, t in times(10):
        azimuth = pose(t)[2] - across
        row = levels[(np.degrees(azimuth) / 1.5).astype(int) % 400]
        gray = noise.normal(shade * row, 2).clip(0, 255).astype(np.uint8)
        rows.append((at, picture(at, "mono8", gray)))
    return received(rows)


def picture(at: int, encoding: str, pixels: np.ndarray) -> Message:
    height, width = pixels.shape[:2]
    return Message(
        header=header(at, "camera_optical_frame"),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels.nbytes // height,
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )


def camera_info() -> list[Received]:
    k = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    rows = []
    for at, _ in times(10):
        one = Message(header=header(at, "camera_optical_frame"), height=HEIGHT, width=WIDTH)
        one.distortion_model, one.d, one.k = "plumb_bob", np.zeros(5), k.reshape(-1)
        one.r, one.p = np.eye(3).reshape(-1), np.hstack((k, np.zeros((3, 1)))).reshape(-1)
        rows.append((at, one))
    return received(rows)


def depth() -> list[Received]:
    noise = np.random.default_rng(8)
    rows = []
    for at, _ in times(10):
        meters = noise.normal(2.5, 0.01, (30, 40)).astype(np.float32)
        meters[:, :2] = np.nan
        rows.append((at, picture(at, "32FC1", meters)))
    return received(rows)


def sonar() -> list[Received]:
    noise = np.random.default_rng(9)
    rows = []
    for at, _ in times(10):
        one = Message(header=header(at, "base_link"), radiation_type=0, field_of_view=0.5)
        one.min_range, one.max_range, one.range = 0.2, 4.0, float(noise.normal(2, 0.01))
        rows.append((at, one))
    return received(rows)


def right_info() -> list[Received]:
    infos = camera_info()
    for _, one in infos:
        one.p = one.p.copy()
        one.p[3] = -FOCAL * 0.12
    return infos


TOPICS = {
    "/imu": ("sensor_msgs/msg/Imu", imu),
    "/odom": ("nav_msgs/msg/Odometry", odometry),
    "/tf": ("tf2_msgs/msg/TFMessage", tf),
    "/tf_static": ("tf2_msgs/msg/TFMessage", tf_static),
    "/fix": ("sensor_msgs/msg/NavSatFix", fix),
    "/joint_states": ("sensor_msgs/msg/JointState", joints),
    "/scan": ("sensor_msgs/msg/LaserScan", scan),
    "/points": ("sensor_msgs/msg/PointCloud2", cloud),
    "/camera/image_raw": ("sensor_msgs/msg/Image", image),
    "/camera/camera_info": ("sensor_msgs/msg/CameraInfo", camera_info),
    "/depth/image": ("sensor_msgs/msg/Image", depth),
    "/sonar": ("sensor_msgs/msg/Range", sonar),
    "/stereo/right/camera_info": ("sensor_msgs/msg/CameraInfo", right_info),
} | clean_packets.TOPICS


def messages() -> Messages:
    """Return the messages of all topics."""
    return {SourceTopic(name, kind): make() for name, (kind, make) in TOPICS.items()}
