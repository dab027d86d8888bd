# SPDX-License-Identifier: Apache-2.0
"""Scenario fields that all kinds of sensors share.

Each kind adds its own fields in `spec.py` of its folder. `rotating_lidar`, `cameras` and
`wheel_encoders` have the fields that several kinds or other processes share. Angles and lengths are
in the units that their names state; the code that uses them converts them.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from msgspec import UNSET, Meta, UnsetType

from groundlink.core.fields import Spec, Vector3
from groundlink.core.frames import multiply, quaternion_from_rpy
from groundlink.messages.base import BusMessage
from groundlink.messages.reading_schedule import Events, ReadingSchedule

from .faults import Fault, Quantity

Rate = Annotated[float, Meta(gt=0, le=400)]
_NAME = r"^[a-z][a-z0-9_]*$"
_TOPIC = r"^/[A-Za-z0-9_/]+$"
_FRAME = r"^[^\s/]\S*$"
_PREFIX = r"^([^\s/]\S*)?$"
_HOST, _PORT = (
    r"[^\s:]+",
    r"([0-9]{1,4}|[1-5][0-9]{4}|6([0-4][0-9]{3}|5([0-4][0-9]{2}|5([0-2][0-9]|3[0-5]))))",
)
_ADDRESS = f"^{_HOST}:{_PORT}$"
_PEER = f"^{_HOST}(:{_PORT})?$"

PATTERNS = {
    _NAME: "lower case letters, digits and underscores, a letter first",
    _TOPIC: "a topic of letters, digits, underscores and slashes that begins with a slash",
    _FRAME: "a frame without blanks that does not begin with a slash",
    _PREFIX: "text without blanks that does not begin with a slash",
    _ADDRESS: "HOST:PORT with a port up to 65535, such as 127.0.0.1:7511",
    _PEER: "HOST or HOST:PORT with a port up to 65535, such as 127.0.0.1:7511",
}
"""Description of each pattern, for error lines."""

Name = Annotated[str, Meta(pattern=_NAME)]
"""Lowercase letters, digits and underscores. Also used as a part of keys, topics and frames."""

RosTopic = Annotated[str, Meta(pattern=_TOPIC)]
Frame = Annotated[str, Meta(pattern=_FRAME)]
"""Name of a tf frame."""

FramePrefix = Annotated[str, Meta(pattern=_PREFIX)]
"""Prefix of frame names, or an empty text."""

Address = Annotated[str, Meta(pattern=_ADDRESS)]
"""HOST:PORT."""

Peer = Annotated[str, Meta(pattern=_PEER)]
"""HOST:PORT, or HOST for all of its ports."""


MOUNT_FROM_OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""Rotation of the optical frame in the mount (REP 103): optical x is to the right, y down, z
forward; the mount's x is forward, z up."""


class Mount(Spec, frozen=True):
    """Pose of a sensor on the vehicle: link_from_sensor, of the base or of a joint's link."""

    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    """Position of the sensor in the frame of its link."""

    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about the fixed axes of the link (REP 103)."""

    joint: Name | UnsetType = UNSET
    """Joint whose link carries the sensor, such as `turret`; none: the base carries it."""

    def rpy_radians(self) -> Vector3:
        """Return roll, pitch and yaw in radians."""
        roll, pitch, yaw = map(math.radians, self.rpy_deg)
        return roll, pitch, yaw

    def quaternion(self, *, optical: bool = False) -> tuple[float, float, float, float]:
        """Return the rotation of link_from_sensor, or of link_from_optical."""
        turned = quaternion_from_rpy(*self.rpy_radians())
        x, y, z, w = multiply(turned, MOUNT_FROM_OPTICAL).tolist() if optical else turned
        return x, y, z, w


class RepairBy(Spec, frozen=True):
    """A repair method for lost datagrams, with its parameter. Exactly one field is set."""

    fec: Annotated[float, Meta(gt=0, le=1)] | None = None
    """Repair data for each message, as a share of the message. Requires the package raptorq at both
    ends."""

    resend: Annotated[float, Meta(ge=0.001, le=60)] | None = None
    """Lost parts are requested and sent again until the message is this old, in seconds."""

    def __post_init__(self) -> None:
        if (self.fec is None) == (self.resend is None):
            raise ValueError("expected either `fec: SHARE` or `resend: SECONDS`")


Repair = Literal["none", "resend"] | RepairBy
"""Repair method of the gateway for a stream. `resend` alone means half a second."""


class Carrier(NamedTuple):
    """Facts of a vehicle that determine the size of its sensors' messages."""

    frame_prefix: str
    base_frame: str
    shafts: tuple[str, ...]
    """Names of the shafts that have encoders."""


class SensorSpec(Spec, frozen=True, tag_field="kind"):
    """Base of all sensor kinds."""

    name: Name
    """Name of the sensor, unique in the vehicle. Part of its keys on the bus."""

    topic: RosTopic
    """ROS topic of the readings."""

    frame: Frame
    """tf frame of the readings, without the vehicle's `frame_prefix`."""

    mount: Mount = Mount()
    """Pose of the sensor on the base. A file may name one of the vehicle's `mounts` instead."""

    push: bool = True
    """True: the gateway sends the stream to its peer without a subscription. False: it sends the
    stream to subscribers only."""

    repair: Repair = "none"
    """Repair of lost datagrams between gateway and ROS. `resend` alone requests lost parts for half
    a second."""

    mounted: ClassVar[bool] = True
    """Whether the static transforms contain `frame` as a mount on the vehicle."""

    optical: ClassVar[bool] = False
    """Whether `frame` is an optical frame (REP 103), in which z points along the mount's x."""

    datasheet: str = ""
    """Data sheet of the device. A file gives its name; a resolved scenario has title and source."""

    host: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_-]*$")] = "main"
    """Label of the machine that the sensor runs on, if containers run on several machines."""

    process: Literal["own", "shared"] | None = None
    """Process of the sensor on one machine: its own, or one that it shares with all sensors of the
    vehicle that do so; None: as its kind. Inertial units, encoders, wheel odometry, range finders
    and satellite receivers share. With more vehicles than cores, several vehicles share the
    processes of their sensors, without those that are `own`. In containers each sensor has its own.
    """

    faults: tuple[Fault, ...] = ()
    """Faults of the sensor, each with its times."""

    seed: Annotated[int, Meta(ge=0)] | None = None
    """Seed of the sensor's random numbers, if it is not that of the scenario."""

    package: str = ""
    """Distribution that installs this kind. The loader fills it in; empty for shipped kinds."""

    quantities: ClassVar[Mapping[str, Quantity]] = {}
    """Quantities of the readings that faults can disturb. The first is the default."""

    rate_field: ClassVar[str] = "rate_hz"
    """Name of the field that holds the rate; part of the reference of the bus."""

    @property
    def kind(self) -> str:
        """Name of the kind, as in a scenario."""
        return str(self.__struct_config__.tag)

    @property
    def message_rate_hz(self) -> float:
        """Return the messages per second of sim time on each stream."""
        rate_hz: float = getattr(self, self.rate_field)
        return rate_hz

    def noise_seed(self, scenario_seed: int) -> int:
        """Return the seed of the sensor's random numbers."""
        return scenario_seed if self.seed is None else self.seed

    @property
    def measuring_s(self) -> float:
        """Return the longest time from the start of a measurement to its message, in seconds."""
        return 0.0

    @property
    def accumulates(self) -> bool:
        """Return whether readings depend on all earlier states, so that missed ones change them."""
        return False

    def schedule(self) -> ReadingSchedule:
        """Return the schedule of readings that are due."""
        return Events(self.message_rate_hz)

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return a message of the main stream of the largest size."""
        raise NotImplementedError(f"the specification of kind `{self.kind}` has no largest_message")

    @property
    def truth_topic(self) -> str | None:
        """ROS topic of the ground truth behind the readings; None if it is not published."""
        return None

    def ros_topics(self) -> dict[str, str]:
        """Return the ROS topic of each stream by name; the main stream has the empty name."""
        return {"": self.topic}


class UnknownSensor(SensorSpec, frozen=True, tag="unknown", kw_only=True):
    """Sensor of a kind that is not installed on this machine.

    It has no streams here and only keeps its position in the scenario.
    """

    rate_hz: float = 1.0
    fields: dict[str, Any]
    """Fields of the sensor as in the scenario, including its own `kind`."""

    @property
    def problem(self) -> str:
        """Return one line with the missing kind and the package to install."""
        kind = self.fields.get("kind")
        fix = f"pip install {self.package}" if self.package else "install the package that has it"
        return f"sensor `{self.name}`: the kind `{kind}` is not installed here. Fix: {fix}"

    def ros_topics(self) -> dict[str, str]:
        """Return no topics."""
        return {}
