# SPDX-License-Identifier: Apache-2.0
"""What every sensor can be told, of whatever kind.

Rule: kinds add their own fields elsewhere, in `sensors.py`, `lidars.py` and `cameras.py`.
Angles and lengths are as a user writes them; they are converted where they are used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from msgspec import Meta

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
"""What each pattern asks for, in the words of an error line."""

Name = Annotated[str, Meta(pattern=_NAME)]
"""Lower case letters, digits and underscores: also a part of a key, a topic and a frame."""

RosTopic = Annotated[str, Meta(pattern=_TOPIC)]
Frame = Annotated[str, Meta(pattern=_FRAME)]
"""A tf frame."""

FramePrefix = Annotated[str, Meta(pattern=_PREFIX)]
"""The beginning of frames, or nothing."""

Address = Annotated[str, Meta(pattern=_ADDRESS)]
"""HOST:PORT."""

Peer = Annotated[str, Meta(pattern=_PEER)]
"""HOST:PORT, or HOST for all of its ports."""


MOUNT_FROM_OPTICAL = (-0.5, 0.5, -0.5, 0.5)
"""REP 103: optical x is to the right, y down, z forward, of a mount with x forward, z up."""


class Mount(Spec, frozen=True):
    """Where a sensor sits: base_from_sensor."""

    xyz_m: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Vector3 = (0.0, 0.0, 0.0)
    """Roll, pitch, yaw about the base's fixed axes (REP 103)."""

    def rpy_radians(self) -> Vector3:
        """Return roll, pitch and yaw in radians."""
        roll, pitch, yaw = map(math.radians, self.rpy_deg)
        return roll, pitch, yaw

    def quaternion(self, *, optical: bool = False) -> tuple[float, float, float, float]:
        """Return base_from_sensor's rotation, or base_from_optical's."""
        turned = quaternion_from_rpy(*self.rpy_radians())
        x, y, z, w = multiply(turned, MOUNT_FROM_OPTICAL).tolist() if optical else turned
        return x, y, z, w


class RepairBy(Spec, frozen=True):
    """One way of making lost datagrams good, with its figure."""

    fec: Annotated[float, Meta(gt=0, le=1)] | None = None
    """Repair data for each message, as a share of it; needs the package raptorq at both ends."""

    resend: Annotated[float, Meta(ge=0.001, le=60)] | None = None
    """Lost parts are asked for and sent again until the message is this old, in seconds."""

    def __post_init__(self) -> None:
        if (self.fec is None) == (self.resend is None):
            raise ValueError("expected `fec: share` or `resend: seconds`, one of the two")


Repair = Literal["none", "resend"] | RepairBy
"""How the gateway makes good what is lost of a stream; `resend` alone is half a second."""


class Carrier(NamedTuple):
    """Facts of a vehicle that determine how large the messages of its sensors are."""

    frame_prefix: str
    base_frame: str
    shafts: tuple[str, ...]
    """Names of the shafts that encoders count."""


class SensorSpec(Spec, frozen=True, tag_field="kind"):
    """What every sensor has."""

    name: Name
    topic: RosTopic
    """ROS topic of its readings."""

    frame: Frame
    """tf frame of its readings, before the vehicle's `frame_prefix`."""

    mount: Mount = Mount()
    push: bool = True
    """Send to the gateway's peer unasked; if not, only to those who subscribe."""

    repair: Repair = "none"
    mounted: ClassVar[bool] = True
    """Whether `frame` is a place on the vehicle, for the static transforms."""

    optical: ClassVar[bool] = False
    """Whether `frame` is turned from the mount as REP 103 has it for cameras: z looks along the
    mount's x."""

    datasheet: str = ""
    """Title of the data sheet that the fields were taken from, with its source."""

    host: Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_-]*$")] = "main"
    """Label of the machine that it runs on, where containers are spread over several."""

    faults: tuple[Fault, ...] = ()
    """What goes wrong with it, and when."""

    package: str = ""
    """Distribution that installs this kind, filled by the loader; empty for shipped kinds."""

    quantities: ClassVar[Mapping[str, Quantity]] = {}
    """What of its readings faults can make wrong by numbers; the first is meant unless named."""

    rate_field: ClassVar[str] = "rate_hz"
    """Field with the rate; part of the reference of the bus."""

    @property
    def kind(self) -> str:
        """Name of the kind."""
        return str(self.__struct_config__.tag)

    @property
    def message_rate_hz(self) -> float:
        """Messages per second of sim time on each stream."""
        rate_hz: float = getattr(self, self.rate_field)
        return rate_hz

    @property
    def measuring_s(self) -> float:
        """Longest time from the begin of a measurement to its message, in seconds."""
        return 0.0

    def schedule(self) -> ReadingSchedule:
        """Return which readings are due."""
        return Events(self.message_rate_hz)

    def largest_message(self, carrier: Carrier) -> BusMessage:
        """Return a message of the main stream that is as large as they get."""
        raise NotImplementedError(f"the specification of kind `{self.kind}` has no largest_message")

    @property
    def truth_topic(self) -> str | None:
        """ROS topic of the truth behind its readings, if it tells that too."""
        return None

    def ros_topics(self) -> dict[str, str]:
        """Return the ROS topic of each of its streams, by name; the main one has none."""
        return {"": self.topic}


class UnknownSensor(SensorSpec, frozen=True, tag="unknown", kw_only=True):
    """Sensor of a kind that is not installed here. It has no streams, only a place in the run."""

    rate_hz: float = 1.0
    fields: dict[str, Any]
    """The sensor as the scenario has it, with its own `kind`."""

    @property
    def problem(self) -> str:
        """One line: what is missing and which package to install."""
        kind = self.fields.get("kind")
        fix = f"pip install {self.package}" if self.package else "install the package that has it"
        return f"sensor `{self.name}`: the kind `{kind}` is not installed here. Fix: {fix}"

    def ros_topics(self) -> dict[str, str]:
        """Return no topics."""
        return {}
