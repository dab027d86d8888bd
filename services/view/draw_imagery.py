# SPDX-License-Identifier: Apache-2.0
"""Draw images, depth images, boxes of objects, scans, ranges and radar detections in Rerun.

The entity of an image is in the frame `<optical frame>/image`. A CameraInfo message ties that frame
to the optical frame; the image then also appears in the 3D view.
"""

import io
import math
import struct

import numpy as np
import PIL.Image
import rerun as rr

from groundlink.messages.base import floats
from groundlink.messages.ground_truth import Detections2D, Detections3D
from groundlink.messages.imagery import (
    CameraInfo,
    CompressedImage,
    Image,
    LaserScan,
    RadarDetections,
    Range,
)
from groundlink.ros.pixels import ENCODINGS, pixels

from .colors import RAINBOW
from .drawing import Drawing, Track
from .point_placement import points_in_world

IMAGE_PLANE_M = 0.6
"""Distance of an image in front of its camera in the 3D view."""

SCAN_COLOR = (255, 90, 90)

DETECTION_RADIUS = -3.0
"""Radius of a radar detection in points of the screen."""

LABELS = ("/semantic", "/instances")
"""Last parts of the entities of images whose pixels are numbers of classes or objects."""

_DEPTH_HEADER = struct.Struct("<iff")
"""Header of compressed_depth_image_transport before the PNG: format, A and B."""


def image(drawing: Drawing, track: Track, path: str, message: Image) -> None:
    """Show an image or, by its encoding, a depth image."""
    if (encoding := ENCODINGS.get(message.encoding)) is None:
        drawing.not_drawn += 1
        return
    array = pixels(encoding, message.data, message.height, message.width, message.row_bytes)
    if path.endswith(LABELS):
        _show(drawing, path, message, rr.SegmentationImage(array))
        return
    drawn = (
        rr.DepthImage(array, meter=encoding.meter, point_fill_ratio=0.4)
        if encoding.meter
        else rr.Image(array, color_model=encoding.channels)
    )
    _show(drawing, path, message, drawn)


def compressed_image(drawing: Drawing, track: Track, path: str, message: CompressedImage) -> None:
    """Show a compressed image without decoding it."""
    said = message.format.lower()
    if "compresseddepth" in said:
        try:
            depth = _compressed_depth(message, meters="32fc1" in said)
        except (OSError, SyntaxError, struct.error):  # what Pillow says of a broken PNG; no header
            drawing.not_drawn += 1
            return
        _show(drawing, path, message, depth)
        return
    kind = next((kind for kind in ("png", "jpeg", "jpg") if kind in said), None)
    if kind is None:
        drawing.not_drawn += 1
        return
    media_type = "image/png" if kind == "png" else "image/jpeg"
    picture = rr.EncodedImage(contents=bytes(message.data), media_type=media_type)
    _show(drawing, path, message, picture)


def _compressed_depth(message: CompressedImage, *, meters: bool) -> rr.AsComponents:
    """Return depth as compressed_depth_image_transport stores it.

    Of 16UC1 the PNG has millimeters. Of meters, 32FC1, it has A / depth + B, with 0 for none, and
    the header has A and B (codec.cpp there).
    """
    png = bytes(message.data[_DEPTH_HEADER.size :])
    if not meters:
        return rr.EncodedDepthImage(png, media_type="image/png", meter=1000.0)
    _, a, b = _DEPTH_HEADER.unpack_from(message.data)
    with PIL.Image.open(io.BytesIO(png)) as file:
        stored = np.asarray(file, np.float32)
    depth_m = np.full(stored.shape, np.nan, np.float32)
    np.divide(a, stored - np.float32(b), out=depth_m, where=stored > 0)
    return rr.DepthImage(depth_m, meter=1.0, point_fill_ratio=0.4)


def _show(
    drawing: Drawing,
    path: str,
    message: Image | CompressedImage | Detections2D,
    drawn: rr.AsComponents,
) -> None:
    drawing.in_frame(path, f"{message.frame}/image")
    drawing.log(path, message.stamp_nanos, drawn)


def camera_info(drawing: Drawing, track: Track, path: str, message: CameraInfo) -> None:
    """Attach the image's frame to the camera's optical frame, whenever it changes."""
    before = drawing.last.get(path)
    if isinstance(before, CameraInfo) and before.intrinsic == message.intrinsic:
        return
    drawing.last[path] = message
    lens = rr.Pinhole(
        image_from_camera=floats(message.intrinsic).reshape(3, 3),
        resolution=[message.width, message.height],
        parent_frame=message.frame,
        child_frame=f"{message.frame}/image",
        image_plane_distance=IMAGE_PLANE_M,
    )
    drawing.log(path, message.stamp_nanos, lens)


def boxes_in_picture(drawing: Drawing, track: Track, path: str, message: Detections2D) -> None:
    """Draw boxes with the names of their objects on the image."""
    rows = floats(message.boxes_px).reshape(-1, 4)
    drawn = rr.Boxes2D(centers=rows[:, :2], sizes=rows[:, 2:], labels=message.names)
    _show(drawing, path, message, drawn)


def boxes_in_space(drawing: Drawing, track: Track, path: str, message: Detections3D) -> None:
    """Draw boxes with the names of their objects in the frame of the sensor."""
    rows = floats(message.boxes).reshape(-1, 10)
    drawing.in_frame(path, message.frame)
    drawn = rr.Boxes3D(
        centers=rows[:, :3], quaternions=rows[:, 3:7], sizes=rows[:, 7:], labels=message.names
    )
    drawing.log(path, message.stamp_nanos, drawn)


def laser_scan(drawing: Drawing, track: Track, path: str, message: LaserScan) -> None:
    """Draw a scan's returns in the world, each with the scanner's pose at its instant."""
    ranges = np.frombuffer(message.ranges_m, np.float32)
    met = np.flatnonzero((ranges >= message.min_range_m) & (ranges <= message.max_range_m))
    angles = message.angle_min_rad + met * message.angle_increment_rad
    directions = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(met))], axis=-1)
    points = (ranges[met, None] * directions).astype(np.float32)
    seconds = (met * message.time_increment_s).astype(np.float32)
    placing = track.link_from(message.frame)
    if placing is not None:
        place, link_from_sensor = placing
        placed = points_in_world(
            points, seconds, message.stamp_nanos, track.links[place], link_from_sensor
        )
        if placed is None:
            drawing.not_drawn += 1
            return
        points = placed
    else:
        drawing.in_frame(path, message.frame)
    if (whole := drawing.revolution(track, path, points)) is not None:
        drawn = rr.Points3D(whole[0], colors=SCAN_COLOR, radii=-2.0)
        drawing.log(path, message.stamp_nanos, drawn)


def radar_detections(drawing: Drawing, track: Track, path: str, message: RadarDetections) -> None:
    """Draw the detections of a frame, colored by their radial velocity from -10 to 10 m/s."""
    drawing.in_frame(path, message.frame)
    records = message.records()
    share = np.clip((records["velocity"] + 10) / 20, 0, 1)
    colors = RAINBOW[(share * 255).astype(np.uint8)]
    points = np.stack([records[axis] for axis in "xyz"], axis=-1)
    drawn = rr.Points3D(points, colors=colors, radii=DETECTION_RADIUS)
    drawing.log(path, message.stamp_nanos, drawn)


def range_reading(drawing: Drawing, track: Track, path: str, message: Range) -> None:
    """Draw a distance as an arrow along the beam and plot it; skip a failed measurement."""
    if math.isnan(message.range_m):
        return
    drawing.in_frame(path, message.frame)
    reach = min(max(message.range_m, message.min_range_m), message.max_range_m)
    near = 1 - reach / max(message.max_range_m, 1e-9)
    arrow = rr.Arrows3D(vectors=[[reach, 0, 0]], colors=[int(RAINBOW[int(near * 255)])])
    drawing.log(path, message.stamp_nanos, arrow)
    at = drawing.sim_nanos(message.stamp_nanos)
    drawing.plots.add(f"{path}/distance", at, [reach], ["distance"])
