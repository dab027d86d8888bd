# SPDX-License-Identifier: Apache-2.0
"""Estimate of message sizes and of the number of datagrams for each message.

The estimate uses only the scenario, for checks before a run. It takes a sensor's largest message in
CDR and the plain fragmentation of PROTOCOL.md, without the overhead of repair and encryption. The
gateway uses `udp_bridge.wire.fragments`, which this module does not import; a test compares the
two.
"""

from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.extras import needs
from groundlink.messages.base import BusMessage, PointCloud, packed
from groundlink.messages.ground_truth import LABELED_POINT, TRUE_POINT, LabeledPoints, TruePoints
from groundlink.scenario.every_sensor import Carrier, SensorSpec
from groundlink.scenario.ros_side import GatewaySettings
from groundlink.scenario.rotating_lidar import RotatingLidar
from groundlink.scenario.schema import Vehicle

BLOCKS_DEG = (180, 120, 90, 72, 60, 45, 40, 36, 30, 24, 20, 15, 12, 10, 9, 8, 6, 5, 4, 3, 2.4, 2, 1)
"""Values of `block_deg` that are suggested for a LiDAR whose messages are too large."""

BESIDE_CLOUDS: dict[str, tuple[type[TruePoints] | type[LabeledPoints], np.dtype[np.void]]] = {
    "truth": (TruePoints, TRUE_POINT),
    "labeled_points": (LabeledPoints, LABELED_POINT),
}
"""Streams with the points of a LiDAR's clouds: message and record of a point, by name. A point
takes more bytes there than in the cloud."""

_MTU, _LOOPBACK_PART, _LARGEST, _IP_FRAGMENT = 1472, 65280, 65507, 1480


class Cut(NamedTuple):
    """Fragmentation of a message into datagrams."""

    body_bytes: int
    parts: int
    part_bytes: int
    datagram_bytes: int
    """Size of all datagrams but the last, including the header."""

    fits: bool
    """Whether the scenario's datagram size is sufficient. If not, larger datagrams are used."""


class NeverFits(ValueError):
    """Error of a message that fits at no datagram size; the text gives the size needed."""


def body_bytes(vehicle: Vehicle, sensor: SensorSpec, stream: str = "") -> int:
    """Return the CDR size of the largest message of a sensor's main stream, or of one beside it."""
    with needs("gateway"):
        from groundlink.ros.cdr import to_cdr
    model = vehicle.model
    shafts = tuple(shaft.name for shaft in model.counted)
    carrier = Carrier(vehicle.frame_prefix, model.base_frame, shafts)
    message: BusMessage = sensor.largest_message(carrier)
    if stream in BESIDE_CLOUDS and isinstance(message, PointCloud):
        kind, record = BESIDE_CLOUDS[stream]
        message = kind(0, message.frame, packed(np.empty(len(message.records()), record)))
    return len(to_cdr(message))


def cut(vehicle: Vehicle, sensor: SensorSpec, gateway: GatewaySettings, stream: str = "") -> Cut:
    """Return the fragmentation of the largest message of a sensor's main stream, or of another.

    Raises
    ------
    NeverFits
        when the message fits at no datagram size.
    """
    size = body_bytes(vehicle, sensor, stream)
    topic = sensor.ros_topics()[stream] if stream else sensor.topic
    names = len(topic.encode()) + len((vehicle.frame_prefix + sensor.frame).encode())
    header = -(-(18 + names) // 4) * 4
    most = 127 if gateway.signed_peer else 255
    grown = [*range(_MTU, _LARGEST, _IP_FRAGMENT), _LARGEST]
    asked = {"mtu": _MTU, "loopback": min(_LOOPBACK_PART + header, _LARGEST)}
    wanted = asked.get(str(gateway.datagram), gateway.datagram)
    for i, datagram in enumerate([int(wanted), *grown]):
        parts = max(1, -(-size // (datagram - header)))
        if parts <= most:
            return Cut(size, parts, datagram - header, datagram, fits=i == 0)
    raise NeverFits(
        f"a message of {size} bytes is more than {most} datagrams hold, "
        f"{most * (_LARGEST - header)} bytes"
    )


def fitting_block_deg(
    vehicle: Vehicle, sensor: RotatingLidar, gateway: GatewaySettings
) -> float | None:
    """Return the largest `block_deg` whose messages fit the scenario's datagrams, or None."""
    for block_deg in BLOCKS_DEG:
        try:
            in_blocks = replace(sensor, block_deg=float(block_deg))
            streams = ["", *(BESIDE_CLOUDS.keys() & sensor.ros_topics().keys())]
            if all(cut(vehicle, in_blocks, gateway, stream).fits for stream in streams):
                return block_deg
        except ValueError:  # The block never fits, or does not divide the field of view.
            continue
    return None
