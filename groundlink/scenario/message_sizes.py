# SPDX-License-Identifier: Apache-2.0
"""How large a sensor's messages get, and into how many datagrams the gateway cuts them.

Rule: an estimate for people before a run, from the scenario alone: the largest message, as ROS
takes it, and the plain cut of PROTOCOL.md without what repair and sealing add. The gateway's own
cut is `udp_bridge.wire.fragments`, which nothing here imports; a test holds the two together.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from groundlink.core.extras import needs
from groundlink.messages.base import POINT, Imu, Message, PointCloud, WheelEncoders, packed
from groundlink.messages.ground_truth import TRUE_POINT, TruePoints
from groundlink.messages.imagery import CompressedImage, Image, LaserScan, Range
from groundlink.messages.navigation import NavSatFix, Odometry

from .ros_side import Gateway
from .schema import Vehicle
from .sensors import (
    Camera,
    DepthCamera,
    Encoders,
    Gnss,
    Lidar,
    Lidar2d,
    RotatingLidar,
    SensorSpec,
    StereoCamera,
    WheelOdometry,
)
from .sensors import Range as RangeSpec

BLOCKS_DEG = (180, 120, 90, 72, 60, 45, 40, 36, 30, 24, 20, 15, 12, 10, 9, 8, 6, 5, 4, 3, 2.4, 2, 1)
"""Azimuths that are offered to a LiDAR whose messages are too large."""

JPEG_NOISE = ((1, 50, 80, 90, 95, 100), (0.42, 0.42, 0.68, 0.91, 1.19, 2.0))
"""Bytes a pixel that libjpeg makes of random colours, by quality: a curve that bends upwards, so
that lines between are above it. A room at 80 takes a seventh of it."""

JPEG_HEAD_BYTES = 1000
"""Tables and all else."""

PNG_BYTES_A_PIXEL = 2.1
"""What libpng makes of random 16 bits."""

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
    message = _largest(vehicle, sensor)
    if truth and isinstance(message, PointCloud):
        points = packed(np.empty(len(message.records()), TRUE_POINT))
        message = TruePoints(0, message.frame, points)
    return len(to_cdr(message))


def cut(vehicle: Vehicle, sensor: SensorSpec, gateway: Gateway, *, truth: bool = False) -> Cut:
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


def fitting_block_deg(vehicle: Vehicle, sensor: Lidar | Lidar2d, gateway: Gateway) -> float | None:
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


def _largest(vehicle: Vehicle, sensor: SensorSpec) -> Message:
    """Return a message of a sensor that is as large as they get."""
    frame = vehicle.frame_prefix + sensor.frame
    if isinstance(sensor, RotatingLidar):
        # Where firings are no multiple of the blocks, some blocks have one more.
        firings = -(-sensor.firings_in_view // sensor.blocks_per_revolution)
    if isinstance(sensor, Lidar2d):
        rays = packed(np.empty(firings, np.float32))
        return LaserScan(0, frame, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, rays, rays)
    if isinstance(sensor, Lidar):
        most = firings * len(sensor.elevations_deg) * sensor.returns_per_ray
        points = np.empty(most, POINT)
        return PointCloud(0, frame, packed(points.view(np.uint8)))
    if isinstance(sensor, Encoders):
        names = tuple(shaft.name for shaft in vehicle.model.counted)
        return WheelEncoders(0, frame, names, (0,) * len(names))
    if isinstance(sensor, Gnss):
        return NavSatFix(0, frame, 0, 0, 0.0, 0.0, 0.0, packed(np.zeros(9)), 0)
    if isinstance(sensor, RangeSpec):
        return Range(0, frame, sensor.radiation, 0.0, 0.0, 0.0, 0.0, 0.0)
    if isinstance(sensor, Camera | StereoCamera):
        return _picture(sensor, frame)
    if isinstance(sensor, DepthCamera):
        return _depth(sensor, frame)
    still = (0.0, 0.0, 0.0)
    if isinstance(sensor, WheelOdometry):
        base, unsure = vehicle.frame_prefix + vehicle.model.base_frame, packed(np.zeros(36))
        level = (0.0, 0.0, 0.0, 1.0)
        return Odometry(0, frame, base, still, level, still, still, unsure, unsure)
    return Imu(0, frame, (0.0, 0.0, 0.0, 1.0), still, still, 0.0, 0.0, 0.0)


def _picture(camera: Camera | StereoCamera, frame: str) -> Message:
    """Return the pixels of a camera, or the JPEG that it makes of pure noise if that is all."""
    pixels = camera.width * camera.height
    if camera.publish == "compressed":
        most = _jpeg_bytes(pixels, camera.jpeg_quality)
        return CompressedImage(0, frame, "jpeg", memoryview(bytes(most)))
    row = camera.width * (3 if camera.encoding in ("rgb8", "bgr8") else 1)
    data = memoryview(bytes(row * camera.height))
    return Image(0, frame, camera.height, camera.width, camera.encoding, row, data)


def _jpeg_bytes(pixels: int, quality: int) -> int:
    """Return how large a JPEG of pure noise gets."""
    return math.ceil(pixels * np.interp(quality, *JPEG_NOISE)) + JPEG_HEAD_BYTES


def _depth(camera: DepthCamera, frame: str) -> Message:
    """Return a depth camera's cloud with a point for every pixel, or an image if that is more."""
    pixels, every = camera.width * camera.height, camera.points_every
    sizes = {
        "": pixels * (2 if camera.encoding == "16UC1" else 4),
        "compressed": int(pixels * PNG_BYTES_A_PIXEL),
        "points": -(-camera.width // every) * -(-camera.height // every) * POINT.itemsize,
        "color": _jpeg_bytes(pixels, camera.color.jpeg_quality) if camera.color else 0,
        "color_image": pixels * 3,
        "camera_info": 0,
        "color_info": 0,
    }
    largest = max(camera.ros_topics(), key=lambda name: sizes[name])
    if largest == "points":
        return PointCloud(0, frame, memoryview(bytes(sizes[largest])))
    row = -(-sizes[largest] // camera.height)
    data = memoryview(bytes(row * camera.height))
    return Image(0, frame, camera.height, camera.width, camera.encoding, row, data)
