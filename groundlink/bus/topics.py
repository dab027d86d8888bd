# SPDX-License-Identifier: Apache-2.0
"""Table of topics: keys, message types and rates of all streams on the bus.

Keys, message types and rates are defined only here. Liveness checks, the command `groundlink
topics`, the reference in `docs/reference/bus.md` and tests are derived from the table.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from groundlink.episode.fault_messages import Faults
from groundlink.messages.base import BusMessage, Relayed, WheelCommand
from groundlink.messages.ground_truth import VITALS_HZ, Bodies, Vitals
from groundlink.messages.imagery import CameraInfo, CompressedImage, Image, LaserScan
from groundlink.messages.missing_readings import MissingReadings
from groundlink.messages.navigation import (
    JointState,
    NavSatFix,
    OccupancyGrid,
    Odometry,
    PoseStamped,
    Transforms,
)
from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import SensorKind, sensor_kinds

from .core_topics import (
    ACK,
    CLOCK,
    COMMAND,
    GATEWAY,
    HEALTH,
    PHYSICS,
    STATE,
    STATE_BATCH,
    BusTopic,
    Delivery,
)


def _of_sensor(
    name: str, message: type[BusMessage], rate: str = "rate_hz", *, bulky: bool = False
) -> BusTopic:
    """Return the row of the main stream of a kind of sensor."""
    return BusTopic(
        name, "{vehicle}/{sensor}", message, f"sensors.{name}", rate, Delivery.ALL, bulky
    )


def _beside(main: BusTopic, messages: Mapping[str, type[BusMessage]]) -> dict[str, BusTopic]:
    """Return the rows of further streams of a publisher, by name."""
    return {
        name: replace(main, name=f"{main.name}.{name}", key=f"{main.key}/{name}", message=message)
        for name, message in messages.items()
    }


def _outputs(kind: SensorKind) -> dict[str, BusTopic]:
    """Return the rows of all streams of a kind of sensor."""
    further = dict(kind.streams)
    main = _of_sensor(kind.name, further.pop(""), kind.spec.rate_field, bulky=kind.bulky)
    return {"": main} | _beside(main, further)


WHEEL_COMMAND, JOINT_COMMAND = _beside(
    COMMAND, {"wheels": WheelCommand, "joints": JointState}
).values()
JOINT_GROUP_COMMAND = replace(
    JOINT_COMMAND, name="command.joints.group", key=f"{JOINT_COMMAND.key}/{{topic}}"
)
"""Row of the commands of `from_ros.joint_groups`; each has its ROS name in the key."""


def joint_stream(key: str) -> str:
    """Return the stream in a joint command's key: `joints`, or `joints/<topic>` of a group."""
    return key.split("/", 4)[4]


FAULTS = BusTopic(
    "faults", "faults/{process}", Faults, "every sensor", "when one begins or ends", Delivery.ALL
)
MISSING_READINGS = BusTopic(
    *("gaps", "gaps/{process}", MissingReadings, "every sensor"),
    *("when readings are missing", Delivery.ALL),
)
GROUND_TRUTH = BusTopic(
    *("ground_truth", "{vehicle}/ground_truth", Odometry, PHYSICS),
    *("ground_truth.rate_hz", Delivery.NEWEST),
)
TRUE_WHEELS, JOINTS = _beside(GROUND_TRUTH, {"wheels": JointState, "joints": JointState}).values()
BODIES = BusTopic("bodies", "bodies", Bodies, PHYSICS, "bodies.rate_hz", Delivery.NEWEST)
TRUE_MAP = BusTopic(
    "true_map", "true_map", OccupancyGrid, PHYSICS, "true_map.rate_hz", Delivery.NEWEST
)
VITALS = BusTopic("vitals", "{vehicle}/vitals", Vitals, PHYSICS, f"{VITALS_HZ} Hz", Delivery.NEWEST)


def _from_ros(name: str, message: type[BusMessage]) -> BusTopic:
    """Return the row of a topic that comes from a vehicle's stack by ROS."""
    key = f"{{vehicle}}/from_ros/{name}"
    return BusTopic(f"from_ros.{name}", key, message, GATEWAY, "as ROS sends", Delivery.ALL)


FROM_ROS = {
    "pose": _from_ros("pose", PoseStamped),
    "odometry": _from_ros("odometry", Odometry),
    "map": _from_ros("map", OccupancyGrid),
    "joints": JOINT_COMMAND,
}
"""Rows by field of the scenario's `from_ros`."""

RELAYED = replace(_from_ros("topics", Relayed), key="{vehicle}/from_ros/topics/{topic}")
"""Row of the further topics of `from_ros`; each has its ROS name in the key."""

OUTPUTS = {kind.name: _outputs(kind) for kind in sensor_kinds().values()}
"""Rows of the streams of each kind of sensor, by name. The main stream has the empty name."""

SENSOR_TOPICS = {kind: rows[""] for kind, rows in OUTPUTS.items()}
"""Row of the main stream of each kind of sensor."""

_EXTRAS: dict[str, type[BusMessage]] = {
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

STREAM_TOPICS = {
    name: row for name, row in SENSOR_TOPICS.items() if sensor_kinds()[name].streamable
} | {
    name: replace(_of_sensor(name, message), publisher="as in vehicles.streams")
    for name, message in _EXTRAS.items()
}
"""Rows of the streams that `vehicles.streams` of a scenario can send to ROS, by kind."""

TOPICS = (
    STATE,
    STATE_BATCH,
    CLOCK,
    COMMAND,
    WHEEL_COMMAND,
    *dict.fromkeys((*SENSOR_TOPICS.values(), *STREAM_TOPICS.values())),
    *(row for rows in OUTPUTS.values() for name, row in rows.items() if name),
    GROUND_TRUTH,
    TRUE_WHEELS,
    JOINTS,
    BODIES,
    TRUE_MAP,
    VITALS,
    *FROM_ROS.values(),
    JOINT_GROUP_COMMAND,
    RELAYED,
    FAULTS,
    MISSING_READINGS,
    ACK,
    HEALTH,
)


@dataclass(frozen=True, kw_only=True)
class Output:
    """A stream of a sensor."""

    name: str
    """Name of the stream in the output of the sensor's model; empty for the main stream."""

    row: BusTopic
    ros_topic: str


def sensor_outputs(spec: SensorSpec) -> list[Output]:
    """Return all streams of a sensor, with their ROS topics."""
    rows = OUTPUTS.get(spec.kind, {})
    return [
        Output(name=name, row=rows[name], ros_topic=topic)
        for name, topic in spec.ros_topics().items()
    ]


def driver_name(vehicle: Vehicle) -> str:
    """Return the name of the process that drives a vehicle along its route."""
    return f"{vehicle.name}/driver"


def driver_names(scenario: Scenario) -> list[str]:
    """Return the driver processes of a run: one for each vehicle with a route."""
    return [driver_name(vehicle) for vehicle in scenario.vehicles if vehicle.route is not None]


def vehicle_streams(scenario: Scenario, run: str) -> Iterator[tuple[str, type[BusMessage]]]:
    """Yield key and message type of the truth, the vitals and all sensor outputs of a run."""
    for vehicle in scenario.vehicles:
        for row in (GROUND_TRUTH, VITALS):
            yield row.key_in(run, vehicle=vehicle.name), row.message
        for sensor in vehicle.sensors:
            for output in sensor_outputs(sensor):
                key = output.row.key_in(run, vehicle=vehicle.name, sensor=sensor.name)
                yield key, output.row.message


def process_names(scenario: Scenario) -> dict[str, str]:
    """Return the processes of a run by name, with the module of each.

    A sensor of a kind that is not installed has an empty module.
    """
    processes = {PHYSICS: "services.physics"}
    for vehicle in scenario.vehicles:
        for sensor in vehicle.sensors:
            kind = sensor_kinds().get(sensor.kind)
            processes[f"{vehicle.name}/{sensor.name}"] = kind.package if kind else ""
    processes |= dict.fromkeys(driver_names(scenario), "services.driver")
    processes[GATEWAY] = "services.gateway"
    return processes
