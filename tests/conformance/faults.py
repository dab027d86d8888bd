# SPDX-License-Identifier: Apache-2.0
"""Faults that real drivers, converters and simulators have, each put into the clean recording."""

from collections.abc import Callable
from typing import Any

import numpy as np

from sensor_conformance.sources.source import Received

from .clean import POINT, point_cloud, stamp, transform, turned, vector
from .fault import FAULTS, Fault, each, fault


def set_stamp(message: Any, nanoseconds: int) -> None:
    message.header.stamp = stamp(nanoseconds)


def nanoseconds(message: Any) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


# Stamps.


@each("the driver does not set the stamp", "stamps.set", "/sonar")
def _(message: Any) -> None:
    set_stamp(message, 0)


@fault("a stamp goes back by 3 ms", "stamps.increasing", "/imu")
def _(messages: list[Received]) -> None:
    set_stamp(messages[300].message, nanoseconds(messages[299].message) - 3_000_000)


@fault("a message is sent twice", "stamps.increasing", "/odom")
def _(messages: list[Received]) -> None:
    messages.insert(100, messages[100])


@fault("the rate halves after a while", "stamps.rate", "/imu")
def _(messages: list[Received]) -> list[Received]:
    return messages[:400] + messages[400::2]


@fault("stamps are those of a queue that is read every 100 ms", "stamps.jitter", "/odom")
def _(messages: list[Received]) -> None:
    for index, (_, message) in enumerate(messages):
        first = nanoseconds(messages[index - index % 5].message)
        set_stamp(message, first + index % 5 * 100_000)


@fault("stamps of a camera jitter by 60 ms", "stamps.jitter", "/camera/image_raw")
def _(messages: list[Received]) -> None:
    for index, (_, message) in enumerate(messages):
        set_stamp(message, nanoseconds(message) + (index * 7 % 4) * 30_000_000)


@fault("a link loses every twelfth message", "stamps.gaps", "/imu")
def _(messages: list[Received]) -> list[Received]:
    return [one for index, one in enumerate(messages) if index % 12 or not index]


@each("a sensor has another time zone", "stamps.clock", "/camera/image_raw")
def _(message: Any) -> None:
    set_stamp(message, nanoseconds(message) + 3600 * 10**9)


@fault("the clock of a sensor is fast by 1 %", "stamps.drift", "/points")
def _(messages: list[Received]) -> None:
    start = nanoseconds(messages[0].message)
    for _, message in messages:
        set_stamp(message, start + round((nanoseconds(message) - start) * 1.01))


@each("stamps are 200 ms ahead", "stamps.future", "/imu")
def _(message: Any) -> None:
    set_stamp(message, nanoseconds(message) + 200_000_000)


# Frames.


@each("the frame is not set", "frames.set", "/imu")
def _(message: Any) -> None:
    message.header.frame_id = ""


@each("the frame has a slash of tf 1", "frames.slash", "/scan")
def _(message: Any) -> None:
    message.header.frame_id = "/lidar_link"


@each("the frame is none of tf", "frames.known", "/points")
def _(message: Any) -> None:
    message.header.frame_id = "velodyne"


def _also(messages: list[Received], parent: str, child: str) -> None:
    at = nanoseconds(messages[0].message.transforms[0])
    one = transform(at, parent, child, vector(0, 0, 0), turned(0))
    messages[0].message.transforms.append(one)


@fault("two nodes publish the pose of the base", "frames.tree", "/tf")
def _(messages: list[Received]) -> None:
    _also(messages, "map", "base_link")


@fault("a frame is its own ancestor", "frames.tree", "/tf_static")
def _(messages: list[Received]) -> None:
    _also(messages, "imu_link", "odom")


@fault("a sensor is not joined to the base", "frames.connected", "/tf_static")
def _(messages: list[Received]) -> None:
    _also(messages, "rack", "radar")


@each("odom is the child of base_link", "frames.order", "/tf")
def _(message: Any) -> None:
    message.transforms[0].header.frame_id = "base_link"
    message.transforms[0].child_frame_id = "odom"


@each("rotations are not normalized", "frames.normalized", "/tf")
def _(message: Any) -> None:
    message.transforms[0].transform.rotation.w *= 1.1


@fault("a static transform changes", "frames.static", "/tf_static")
def _(messages: list[Received]) -> None:
    mount = messages[0].message.transforms[0]
    moved = transform(0, mount.header.frame_id, mount.child_frame_id, vector(1, 0, 0), turned(0))
    moved.header = mount.header
    messages[0].message.transforms.append(moved)


@fault("an old transform arrives", "frames.increasing", "/tf")
def _(messages: list[Received]) -> None:
    messages.insert(200, messages[50])


@fault("odom jumps when the map is corrected", "frames.continuous", "/tf")
def _(messages: list[Received]) -> None:
    for _, message in messages[200:]:
        message.transforms[0].transform.translation.x += 2.0


@fault("the optical frame is turned like the body", "frames.optical", "/tf_static")
def _(messages: list[Received]) -> None:
    messages[0].message.transforms[-1].transform.rotation = turned(0)


# IMU.


@fault("a reading is NaN", "imu.finite", "/imu")
def _(messages: list[Received]) -> None:
    messages[10].message.angular_velocity.x = float("nan")


def _scaled(value: Any, factor: float) -> None:
    value.x, value.y, value.z = value.x * factor, value.y * factor, value.z * factor


@each("acceleration is in g", "imu.gravity", "/imu")
def _(message: Any) -> None:
    _scaled(message.linear_acceleration, 1 / 9.81)


@each("gravity is removed", "imu.gravity", "/imu")
def _(message: Any) -> None:
    message.linear_acceleration.z -= 9.81


@each("z points down, tf says up", "imu.up", "/imu")
def _(message: Any) -> None:
    message.linear_acceleration.z *= -1


@each("there is no orientation, and covariance[0] is not -1", "imu.orientation", "/imu")
def _(message: Any) -> None:
    _scaled(message.orientation, 0)
    message.orientation.w = 0.0


@each("the orientation is that of z down", "imu.rate_of_orientation", "/imu")
def _(message: Any) -> None:
    message.orientation.z *= -1


@each("angular velocity is in degrees/s", "turning.scale", "/imu")
def _(message: Any) -> None:
    _scaled(message.angular_velocity, 180 / np.pi)


@each("the gyroscope is left-handed", "turning.direction", "/imu")
def _(message: Any) -> None:
    _scaled(message.angular_velocity, -1)


@each("axes of the gyroscope are exchanged", "turning.direction", "/imu")
def _(message: Any) -> None:
    value = message.angular_velocity
    value.y, value.z = value.z, value.y


@fault("readings are 200 ms late", "turning.delay", "/imu")
def _(messages: list[Received]) -> None:
    for _, message in messages:
        set_stamp(message, nanoseconds(message) + 200_000_000)


@fault("readings freeze for 400 ms", "imu.alive", "/imu")
def _(messages: list[Received]) -> None:
    for _, message in messages[200:240]:
        message.angular_velocity = messages[200].message.angular_velocity
        message.linear_acceleration = messages[200].message.linear_acceleration


@each("angular velocity is rounded to 0.05 rad/s", "imu.resolution", "/imu")
def _(message: Any) -> None:
    value = message.angular_velocity
    value.x, value.y, value.z = (round(one / 0.05) * 0.05 for one in (value.x, value.y, value.z))


@each("the gyroscope clips at 0.5 rad/s", "imu.saturation", "/imu")
def _(message: Any) -> None:
    message.angular_velocity.z = min(message.angular_velocity.z, 0.5)


@each("the gyroscope has a bias of 0.3 rad/s", "imu.bias", "/imu")
def _(message: Any) -> None:
    message.angular_velocity.y += 0.3


# Odometry and joints.


@each("pose and twist are in odom", "odometry.frames", "/odom")
def _(message: Any) -> None:
    message.child_frame_id = "odom"


@fault("a quaternion is zero", "odometry.finite", "/odom")
def _(messages: list[Received]) -> None:
    messages[7].message.pose.pose.orientation.w = 0.0


@each("the twist is in the frame odom", "odometry.twist", "/odom")
def _(message: Any) -> None:
    turn = message.pose.pose.orientation
    yaw = 2 * np.arctan2(turn.z, turn.w) + 0.6
    speed = message.twist.twist.linear.x
    message.twist.twist.linear = vector(speed * np.cos(yaw), speed * np.sin(yaw), 0)


@each("the twist is in km/h", "odometry.twist", "/odom")
def _(message: Any) -> None:
    _scaled(message.twist.twist.linear, 3.6)


@each("clockwise is positive", "odometry.turn", "/odom")
def _(message: Any) -> None:
    _scaled(message.twist.twist.angular, -1)


@fault("the pose jumps by 3 m", "odometry.continuous", "/odom")
def _(messages: list[Received]) -> None:
    for _, message in messages[250:]:
        message.pose.pose.position.y += 3.0


@each("velocities are in revolutions/s", "joints.velocity", "/joint_states")
def _(message: Any) -> None:
    message.velocity = [one / (2 * np.pi) for one in message.velocity]


@each("a velocity is missing", "joints.lengths", "/joint_states")
def _(message: Any) -> None:
    message.velocity = message.velocity[:1]


# Covariances.


@each("a variance is negative", "covariance.valid", "/odom")
def _(message: Any) -> None:
    message.pose.covariance[7] = -0.1


@each("a covariance is not symmetric", "covariance.valid", "/fix")
def _(message: Any) -> None:
    message.position_covariance[1] = 0.001


@each("the covariance is a thousandth of the deviation", "covariance.spread", "/imu")
def _(message: Any) -> None:
    message.angular_velocity_covariance *= 1e-6


@each("a known covariance is zero", "covariance.type", "/fix")
def _(message: Any) -> None:
    message.position_covariance = np.zeros(9)


# Satellite receivers.


@each("degrees and minutes of NMEA are not converted", "gnss.range", "/fix")
def _(message: Any) -> None:
    degrees = int(message.latitude)
    message.latitude = degrees * 100 + (message.latitude - degrees) * 60


@each("latitude and longitude are in radians", "gnss.against_odometry", "/fix")
def _(message: Any) -> None:
    message.latitude, message.longitude = np.radians((message.latitude, message.longitude))


@each("latitude and longitude are exchanged", "gnss.against_odometry", "/fix")
def _(message: Any) -> None:
    message.latitude, message.longitude = message.longitude, message.latitude


@fault("a fix has no position", "gnss.no_fix", "/fix")
def _(messages: list[Received]) -> None:
    messages[3].message.latitude = float("nan")


@each("positions were float32", "gnss.resolution", "/fix")
def _(message: Any) -> None:
    message.latitude = float(np.float32(message.latitude))


# Cameras.


@each("the encoding is a made-up one", "image.encoding", "/camera/image_raw")
def _(message: Any) -> None:
    message.encoding = "gray"


@each("the step is that of three channels", "image.size", "/camera/image_raw")
def _(message: Any) -> None:
    message.step *= 3


@fault("an image is cut off", "image.decodes", "/camera/image_raw")
def _(messages: list[Received]) -> None:
    messages[20].message.data = messages[20].message.data[:5000]


@each("the calibration is of another resolution", "camera.info_size", "/camera/camera_info")
def _(message: Any) -> None:
    message.width, message.height = 640, 480


@each("the calibration has a stamp of its own", "camera.info_stamp", "/camera/camera_info")
def _(message: Any) -> None:
    set_stamp(message, nanoseconds(message) + 4_000_000)


@each("the focal length is in millimeters", "camera.matrix", "/camera/camera_info")
def _(message: Any) -> None:
    message.k[0] = message.k[4] = 4.2


@each("three coefficients of five", "camera.distortion", "/camera/camera_info")
def _(message: Any) -> None:
    message.d = np.zeros(3)


@each("the rectification mirrors", "camera.rectification", "/camera/camera_info")
def _(message: Any) -> None:
    message.r = np.diag([1.0, -1.0, 1.0]).reshape(-1)


@each("the right camera has a positive Tx", "camera.baseline", "/stereo/right/camera_info")
def _(message: Any) -> None:
    message.p[3] *= -1


def _repaint(message: Any, paint: Callable[[np.ndarray], np.ndarray], kind: str = "u1") -> None:
    pixels = message.data.view(kind).reshape(message.height, message.width)
    changed = np.ascontiguousarray(paint(pixels).astype(kind))
    message.data = np.frombuffer(changed.tobytes(), np.uint8)


@each("pictures are overexposed", "image.exposure", "/camera/image_raw")
def _(message: Any) -> None:
    _repaint(message, lambda pixels: (pixels * 8.0).clip(0, 255))


def _blurred(pixels: np.ndarray) -> np.ndarray:
    sums = np.cumsum(np.pad(pixels.astype(float), ((0, 0), (16, 16)), mode="edge"), axis=1)
    once = (sums[:, 32:] - sums[:, :-32]) / 32
    sums = np.cumsum(np.pad(once, ((0, 0), (16, 16)), mode="edge"), axis=1)
    return np.asarray((sums[:, 32:] - sums[:, :-32])[:, : pixels.shape[1]] / 32)


@each("pictures are out of focus", "image.sharpness", "/camera/image_raw")
def _(message: Any) -> None:
    _repaint(message, _blurred)


@fault("the picture freezes for 2 s", "image.alive", "/camera/image_raw")
def _(messages: list[Received]) -> None:
    for _, message in messages[40:60]:
        message.data = messages[40].message.data


@each("pictures have 4 bits", "image.levels", "/camera/image_raw")
def _(message: Any) -> None:
    _repaint(message, lambda pixels: pixels // 16 * 16)


@each("pictures are mirrored", "turning.direction", "/camera/image_raw")
def _(message: Any) -> None:
    _repaint(message, lambda pixels: pixels[:, ::-1])


@each("pictures are 400 ms late", "turning.delay", "/camera/image_raw")
def _(message: Any) -> None:
    set_stamp(message, nanoseconds(message) + 400_000_000)


@each("depth is in millimeters as 32FC1", "depth.units", "/depth/image")
def _(message: Any) -> None:
    _repaint(message, lambda pixels: pixels * 1000, "f4")


@each("pixels without depth are zero", "depth.invalid", "/depth/image")
def _(message: Any) -> None:
    _repaint(message, np.nan_to_num, "f4")


@each("depth has steps of 20 cm", "depth.resolution", "/depth/image")
def _(message: Any) -> None:
    columns = np.linspace(-1, 1, message.width)
    _repaint(message, lambda pixels: np.round((pixels + columns) / 0.2) * 0.2, "f4")


# Planar scans and ranges.


@each("the increment is in degrees", "scan.angles", "/scan")
def _(message: Any) -> None:
    message.angle_increment = 1.0


@each("the scan time is in milliseconds", "scan.times", "/scan")
def _(message: Any) -> None:
    message.scan_time = 100.0


@each("no return is range_max + 1", "scan.limits", "/scan")
def _(message: Any) -> None:
    message.ranges = np.where(np.isfinite(message.ranges), message.ranges, 31).astype(np.float32)


@each("nothing returns", "scan.returns", "/scan")
def _(message: Any) -> None:
    message.ranges = np.full(360, np.inf, np.float32)


@each("ranges have steps of 50 cm", "scan.noise", "/scan")
def _(message: Any) -> None:
    message.ranges = (np.round(message.ranges * 2) / 2).astype(np.float32)


@each("the scan is clockwise", "turning.direction", "/scan")
def _(message: Any) -> None:
    message.ranges = message.ranges[::-1]


@each("no echo is 0", "range.limits", "/sonar")
def _(message: Any) -> None:
    message.range = 0.0


@each("the field of view is in degrees", "range.cone", "/sonar")
def _(message: Any) -> None:
    message.field_of_view = 30.0


# Clouds.


def cloud(name: str, clause: str) -> Callable[[Callable[[np.ndarray], np.ndarray]], None]:
    """Add a fault of the points of every cloud."""

    def add(change: Callable[[np.ndarray], np.ndarray]) -> None:
        def alter(messages: list[Received]) -> list[Received]:
            changed = []
            for at, message in messages:
                points = change(np.frombuffer(message.data.tobytes(), POINT).copy())
                one = point_cloud(nanoseconds(message), points)
                changed.append(Received(at, one))
            return changed

        FAULTS.append(Fault(name, clause, "/points", alter))

    return add


def _moved(points: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Put points at other ranges on their rays."""
    factor = distance / _distance(points)
    for axis in "xyz":
        points[axis] *= factor
    return points


def _distance(points: np.ndarray) -> np.ndarray:
    return np.sqrt(points["x"] ** 2.0 + points["y"] ** 2.0 + points["z"] ** 2.0)


@each("row_step is that of another width", "cloud.layout", "/points")
def _(message: Any) -> None:
    message.row_step += message.point_step


@cloud("rings are float32", "cloud.fields")
def _(points: np.ndarray) -> np.ndarray:
    return points.astype([(name, "f4" if name == "ring" else POINT[name]) for name in POINT.names])


@cloud("a dense cloud holds NaN", "cloud.dense")
def _(points: np.ndarray) -> np.ndarray:
    points["x"][::50] = np.nan
    return points


@cloud("rays without return are points at the origin", "cloud.no_return")
def _(points: np.ndarray) -> np.ndarray:
    for axis in "xyz":
        points[axis][::20] = 0
    return points


@fault("packets of one cloud are lost", "cloud.count", "/points")
def _(messages: list[Received]) -> None:
    message = messages[30].message
    points = np.frombuffer(message.data.tobytes(), POINT)[: message.width // 3]
    messages[30] = Received(messages[30].time, point_cloud(nanoseconds(message), points))


@cloud("times are in milliseconds", "cloud.times")
def _(points: np.ndarray) -> np.ndarray:
    points["time"] *= 1000
    return points


@cloud("times are those of another order of points", "cloud.time_order")
def _(points: np.ndarray) -> np.ndarray:
    points["time"] = np.random.default_rng(1).permutation(points["time"])
    return points


@cloud("times are not even", "cloud.spin")
def _(points: np.ndarray) -> np.ndarray:
    points["time"] = points["time"] ** 2 * 10
    return points


@cloud("times count from the start of the sensor", "cloud.stamp")
def _(points: np.ndarray) -> np.ndarray:
    points["time"] += 20.0
    return points


@cloud("rings are in the order of firing", "cloud.rings")
def _(points: np.ndarray) -> np.ndarray:
    points["ring"] = np.array([0, 4, 1, 5, 2, 6, 3, 7])[points["ring"]]
    return points


@cloud("intensities are all zero", "cloud.intensity")
def _(points: np.ndarray) -> np.ndarray:
    points["intensity"] = 0
    return points


@cloud("ranges have no noise", "cloud.noise_by_range")
def _(points: np.ndarray) -> np.ndarray:
    return _moved(points, np.full(len(points), 12.0))


@cloud("far ranges have a noise of 20 cm", "cloud.noise_by_range")
def _(points: np.ndarray) -> np.ndarray:
    distance = _distance(points)
    more = np.random.default_rng(2).normal(0, 0.2, len(points)) * (distance > 22)
    return _moved(points, distance + more)


@cloud("dim returns have a noise of 20 cm", "cloud.noise_by_intensity")
def _(points: np.ndarray) -> np.ndarray:
    azimuth = np.arctan2(points["y"], points["x"])
    dim = azimuth < -2
    points["intensity"] = np.where(dim, 3, 50 + points["intensity"])
    more = np.random.default_rng(3).normal(0, 0.2, len(points)) * dim
    return _moved(points, _distance(points) + more)


@cloud("all ranges have a noise of 30 cm", "cloud.noise_by_incidence")
def _(points: np.ndarray) -> np.ndarray:
    more = np.random.default_rng(4).normal(0, 0.3, len(points))
    return _moved(points, _distance(points) + more)


@cloud("ranges have steps of 5 cm", "cloud.range_steps")
def _(points: np.ndarray) -> np.ndarray:
    return _moved(points, np.round(_distance(points) / 0.05) * 0.05)


@cloud("y points to the right", "turning.direction")
def _(points: np.ndarray) -> np.ndarray:
    points["y"] *= -1
    return points
