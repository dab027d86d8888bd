# SPDX-License-Identifier: Apache-2.0
"""The table of topics: every kind of stream on the bus, in one place.

Rule: a key, a message type or a rate is written here and nowhere else. Liveness checks, the
command `groundlink topics`, documentation and tests are derived from the table.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from groundlink.messages.base import Imu, Message, PointCloud, WheelCommand, WheelEncoders
from groundlink.messages.faults import Faults
from groundlink.messages.ground_truth import Bodies, TruePoints
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image, LaserScan, Range
from groundlink.messages.missing_readings import Gaps
from groundlink.messages.navigation import (
    JointState,
    NavSatFix,
    OccupancyGrid,
    Odometry,
    PoseStamped,
    Transforms,
)
from groundlink.messages.relayed import Relayed
from groundlink.messages.vitals import VITALS_HZ, Vitals
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensors import (
    Camera,
    DepthCamera,
    Encoders,
    Gnss,
    Lidar,
    Lidar2d,
    Sensor,
    SensorSpec,
    StereoCamera,
    WheelOdometry,
)
from groundlink.scenario.sensors import Imu as ImuSpec
from groundlink.scenario.sensors import Range as RangeSpec

from .core_topics import (
    ACK,
    CLOCK,
    COMMAND,
    GATEWAY,
    HEALTH,
    PHYSICS,
    STATE,
    BusTopic,
    Delivery,
)


def _of_sensor(
    name: str, message: type[Message], rate: str = "rate_hz", *, bulky: bool = False
) -> BusTopic:
    """Return the row of a kind of sensor's main stream."""
    return BusTopic(
        name=name,
        key="{vehicle}/{sensor}",
        message=message,
        publisher=f"sensors.{name}",
        rate=rate,
        delivery=Delivery.ALL,
        bulky=bulky,
    )


def _beside(main: BusTopic, **messages: type[Message]) -> dict[str, BusTopic]:
    """Return the rows of what a sensor publishes beside its main stream, by name."""
    return {
        name: replace(main, name=f"{main.name}.{name}", key=f"{main.key}/{name}", message=message)
        for name, message in messages.items()
    }


WHEEL_COMMAND, JOINT_COMMAND = _beside(COMMAND, wheels=WheelCommand, joints=JointState).values()
POINTS = _of_sensor("lidar", PointCloud, "rotation_rate_hz", bulky=True)
SCAN = _of_sensor("lidar_2d", LaserScan, "rotation_rate_hz")
IMU = _of_sensor("imu", Imu)
ENCODERS = _of_sensor("encoders", WheelEncoders)
GNSS = _of_sensor("gnss", NavSatFix)
RANGE = _of_sensor("range", Range)
WHEEL_ODOMETRY = _of_sensor("wheel_odometry", Odometry)
CAMERA = _of_sensor("camera", CompressedImage, bulky=True)
DEPTH_CAMERA = _of_sensor("depth_camera", Image, bulky=True)
STEREO_CAMERA = _of_sensor("stereo_camera", Image, bulky=True)
FAULTS = BusTopic(
    name="faults",
    key="faults/{process}",
    message=Faults,
    publisher="every sensor",
    rate="when one begins or ends",
    delivery=Delivery.ALL,
)
GAPS = replace(
    FAULTS, name="gaps", key="gaps/{process}", message=Gaps, rate="when readings are missing"
)
GROUND_TRUTH = BusTopic(
    name="ground_truth",
    key="{vehicle}/ground_truth",
    message=Odometry,
    publisher="physics",
    rate="ground_truth.rate_hz",
    delivery=Delivery.NEWEST,
)
TRUE_WHEELS, JOINTS = _beside(GROUND_TRUTH, wheels=JointState, joints=JointState).values()
TRUE_POINTS = replace(
    POINTS,
    name="lidar.truth",
    key="{vehicle}/{sensor}/truth",
    message=TruePoints,
    rate="as the cloud",
)
BODIES = replace(STATE, name="bodies", key="bodies", message=Bodies, rate="bodies.rate_hz")
VITALS = BusTopic(
    name="vitals",
    key="{vehicle}/vitals",
    message=Vitals,
    publisher="physics",
    rate=f"{VITALS_HZ} Hz",
    delivery=Delivery.NEWEST,
)


def _from_ros(name: str, message: type[Message]) -> BusTopic:
    """Return the row of what a vehicle's stack tells by ROS."""
    return BusTopic(
        name=f"from_ros.{name}",
        key=f"{{vehicle}}/from_ros/{name}",
        message=message,
        publisher="gateway",
        rate="as ROS sends",
        delivery=Delivery.ALL,
    )


FROM_ROS = {
    "pose": _from_ros("pose", PoseStamped),
    "odometry": _from_ros("odometry", Odometry),
    "map": _from_ros("map", OccupancyGrid),
    "joints": JOINT_COMMAND,
}
"""By field of the scenario's `from_ros`."""

RELAYED = replace(_from_ros("topics", Relayed), key="{vehicle}/from_ros/topics/{topic}")
"""Of its further topics, each under its name in ROS."""

SENSOR_TOPICS: dict[type[SensorSpec], BusTopic] = {
    Lidar: POINTS,
    Lidar2d: SCAN,
    ImuSpec: IMU,
    Encoders: ENCODERS,
    WheelOdometry: WHEEL_ODOMETRY,
    Gnss: GNSS,
    RangeSpec: RANGE,
    Camera: CAMERA,
    DepthCamera: DEPTH_CAMERA,
    StereoCamera: STEREO_CAMERA,
}
"""The main stream of each kind of sensor."""

SIDE_TOPICS: dict[type[SensorSpec], dict[str, BusTopic]] = {
    Camera: _beside(CAMERA, image=Image, camera_info=CameraInfo),
    DepthCamera: _beside(
        DEPTH_CAMERA,
        compressed=CompressedImage,
        camera_info=CameraInfo,
        points=PointCloud,
        color=CompressedImage,
        color_image=Image,
        color_info=CameraInfo,
    ),
    StereoCamera: _beside(
        STEREO_CAMERA,
        compressed=CompressedImage,
        camera_info=CameraInfo,
        right=Image,
        right_compressed=CompressedImage,
        right_camera_info=CameraInfo,
    ),
    Lidar: {"truth": TRUE_POINTS},
}
"""What kinds of sensors publish beside it, by name; which of it is the specification's choice."""

_EXTRAS: dict[str, type[Message]] = {
    "image": Image,
    "compressed_image": CompressedImage,
    "camera_info": CameraInfo,
    "laser_scan": LaserScan,
    "nav_sat_fix": NavSatFix,
    "pose": PoseStamped,
    "odometry": Odometry,
    "map": OccupancyGrid,
    "transforms": Transforms,
    "joint_state": JointState,
}

_CAMERAS = (CAMERA, DEPTH_CAMERA, STEREO_CAMERA)

STREAM_TOPICS = {topic.name: topic for topic in SENSOR_TOPICS.values() if topic not in _CAMERAS} | {
    name: replace(_of_sensor(name, message), publisher="as in vehicles.streams")
    for name, message in _EXTRAS.items()
}
"""By kind: every stream that a scenario can send to ROS."""

TOPICS = (
    STATE,
    CLOCK,
    COMMAND,
    WHEEL_COMMAND,
    *STREAM_TOPICS.values(),
    *_CAMERAS,
    *(topic for sides in SIDE_TOPICS.values() for topic in sides.values()),
    GROUND_TRUTH,
    TRUE_WHEELS,
    JOINTS,
    TRUE_POINTS,
    BODIES,
    VITALS,
    *FROM_ROS.values(),
    RELAYED,
    FAULTS,
    GAPS,
    ACK,
    HEALTH,
)


@dataclass(frozen=True, kw_only=True)
class Output:
    """One of the streams of a sensor."""

    name: str
    """By which the sensor's model tags what belongs to it; empty for the main one."""

    row: BusTopic
    ros_topic: str


def sensor_outputs(spec: Sensor) -> list[Output]:
    """Return every stream of a sensor, with its ROS topic."""
    rows = SIDE_TOPICS.get(type(spec), {}) | {"": SENSOR_TOPICS[type(spec)]}
    return [
        Output(name=name, row=rows[name], ros_topic=topic)
        for name, topic in spec.ros_topics().items()
    ]


def driver_name(vehicle: Vehicle) -> str:
    """Return the name of the process that drives a vehicle along a route."""
    return f"{vehicle.name}/driver"


def driver_names(scenario: Scenario) -> list[str]:
    """Return the drivers that a run needs: of every vehicle with a route."""
    return [driver_name(vehicle) for vehicle in scenario.vehicles if vehicle.route is not None]


def process_names(scenario: Scenario) -> dict[str, str]:
    """Return the processes of a run, by name, with the module that each one is."""
    processes = {PHYSICS: "services.physics"}
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            module = f"services.sensors.{SENSOR_TOPICS[type(sensor)].name}"
            processes[f"{vehicle.name}/{sensor.name}"] = module
    processes |= dict.fromkeys(driver_names(scenario), "services.driver")
    processes[GATEWAY] = "services.gateway"
    return processes
