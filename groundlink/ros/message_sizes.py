# SPDX-License-Identifier: Apache-2.0
"""How large a sensor's messages get, and into how many datagrams the gateway cuts them.

Rule: an estimate for people before a run, from the scenario alone: the largest message, as ROS
takes it, and the plain cut of PROTOCOL.md without what repair and sealing add. The gateway's own
cut is `udp_bridge.wire.fragments`, which nothing here imports; a test holds the two together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.extras import needs
from groundlink.messages.base import PointCloud, packed
from groundlink.messages.ground_truth import TRUE_POINT, TruePoints
from groundlink.scenario.every_sensor import Carrier, SensorSpec
from groundlink.scenario.lidars import RotatingLidar
from groundlink.scenario.ros_side import GatewaySettings
from groundlink.scenario.schema import Vehicle

BLOCKS_DEG = (180, 120, 90, 72, 60, 45, 40, 36, 30, 24, 20, 15, 12, 10, 9, 8, 6, 5, 4, 3, 2.4, 2, 1)
"""Azimuths that are offered to a LiDAR whose messages are too large."""

_MTU, _LOOPBACK_PART, _LARGEST, _IP_FRAGMENT = 1472, 65280, 65507, 1480


class Cut(NamedTuple):
    """A message in datagrams."""

    body_bytes: int
    parts: int
    part_bytes: int
    datagram_bytes: int
    """Of all parts but the last, header included."""

    fits: bool
    """Whether the scenario's datagram size suffices; if not, datagrams are larger."""


class NeverFits(ValueError):
    """A message that fits at no datagram size; the text says how much would."""


def body_bytes(vehicle: Vehicle, sensor: SensorSpec, *, truth: bool = False) -> int:
    """Return the bytes of a sensor's largest message in CDR, or of the truth behind it."""
    with needs("gateway"):
        from groundlink.ros.cdr import to_cdr
    model = vehicle.model
    shafts = tuple(shaft.name for shaft in model.counted)
    carrier = Carrier(vehicle.frame_prefix, model.base_frame, shafts)
    message = sensor.largest_message(carrier)
    if truth and isinstance(message, PointCloud):
        points = packed(np.empty(len(message.records()), TRUE_POINT))
        message = TruePoints(0, message.frame, points)
    return len(to_cdr(message))


def cut(
    vehicle: Vehicle, sensor: SensorSpec, gateway: GatewaySettings, *, truth: bool = False
) -> Cut:
    """Return how a sensor's largest message is sent, or the truth behind it.

    Raises
    ------
    NeverFits
        when it is not, at any datagram size.
    """
    size = body_bytes(vehicle, sensor, truth=truth)
    topic = (sensor.truth_topic if truth else None) or sensor.topic
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
    """Return the largest `block_deg` whose messages fit the scenario's datagrams, if any does."""
    for block_deg in BLOCKS_DEG:
        try:
            in_blocks = replace(sensor, block_deg=float(block_deg))
            truths = {False, sensor.truth_topic is not None}
            if all(cut(vehicle, in_blocks, gateway, truth=truth).fits for truth in truths):
                return block_deg
        except ValueError:  # never fits, or is no part of the field of view
            continue
    return None
