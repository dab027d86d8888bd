# SPDX-License-Identifier: Apache-2.0
"""Depth camera model: turn states of the world into depth images with their CameraInfo.

All messages of one picture (depth, color, points) have the same stamp and the same pixels. Depth is
that of the middle of the exposure. The lens distorts depth and color alike; other effects of lens
and image sensor apply to color only. Only outputs that the scenario enables are computed.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from groundlink.messages.base import BusMessage
from groundlink.scenario.schema import Scenario, Vehicle
from services.sensors.noise.random_streams import RandomStreams
from services.sensors.rendering.cameras.messages import camera_info, image, jpeg
from services.sensors.runtime.model import StreamMessage
from services.sensors.runtime.picture_times import PictureModel

from .eyes import DepthEye, depth_eye
from .forms import compressed_depth, pixels, points
from .spec import DepthCamera


class DepthCameraModel(PictureModel):
    """Depth camera of a vehicle.

    Parameters
    ----------
    eye : DepthEye, optional
        Source of true depth. The default is OpenGL, or ray casting without OpenGL.

    Raises
    ------
    UserError
        when neither OpenGL nor Embree is available, or color is enabled without OpenGL, or the lens
        cannot be drawn.
    """

    def __init__(
        self,
        scenario: Scenario,
        vehicle: Vehicle,
        spec: DepthCamera,
        *,
        eye: DepthEye | None = None,
    ) -> None:
        self._spec = spec
        self._eye = eye or depth_eye(scenario, vehicle, spec)
        super().__init__(spec, self._eye, span_nanos=self._eye.span_nanos)
        self._frame = vehicle.frame_prefix + spec.frame
        self._outputs = spec.ros_topics().keys()
        self._streams = RandomStreams(spec.noise_seed(scenario.seed), f"{vehicle.name}/{spec.name}")

    def taken(self, nanos: int, tick: int, stamp_nanos: int) -> list[BusMessage | StreamMessage]:
        """Return the messages of the picture at an instant."""
        spec, outputs, header = self._spec, self._outputs, (stamp_nanos, self._frame)
        truth_m, color = self._eye.look(nanos, tick)
        pinhole = self._eye.pinhole
        depth_m = measured(truth_m, pinhole.fx, spec, self._streams.at("disparity", tick))
        info = camera_info(*header, pinhole, spec.lens)
        made: list[BusMessage | StreamMessage] = [StreamMessage("camera_info", info)]
        if "" in outputs:
            made.append(image(*header, spec.encoding, pixels(depth_m, spec.encoding)))
        if "compressed" in outputs:
            file = compressed_depth(*header, depth_m, spec.encoding, spec.max_range_m)
            made.append(StreamMessage("compressed", file))
        if "points" in outputs:
            slopes = self._eye.slopes
            cloud = points(*header, depth_m, slopes, every=spec.points_every, color=color)
            made.append(StreamMessage("points", cloud))
        if spec.color and color is not None:
            made.append(StreamMessage("color_info", info))
            if "color" in outputs:
                quality = spec.color.jpeg_quality
                made.append(
                    StreamMessage("color", jpeg(*header, color, gray=False, quality=quality))
                )
            if "color_image" in outputs:
                made.append(StreamMessage("color_image", image(*header, "rgb8", color)))
        return [*made, *self._eye.labels(nanos, stamp_nanos)]


Reals = NDArray[np.float32]
Flags = NDArray[np.bool_]

JUMP_PX = 1.0
"""Neighboring pixels whose disparities differ by more belong to two surfaces."""


def measured(truth_m: Reals, fx: float, spec: DepthCamera, generator: np.random.Generator) -> Reals:
    """Return the measured depth for true depth, shape (height, width), infinite in the sky.

    Both are along z of the optical frame. Values follow REP 117 and 118: -inf for too near, +inf
    beyond the largest range and in the sky, NaN where no depth is found. A stereo pair finds depth
    by matching each pixel of the left eye with a pixel in the same row of the right eye,
    `disparity` = f baseline / z columns to the left. The effect of texture on matching is not
    modeled.

    Disparity noise of standard deviation s causes depth noise of standard deviation z^2 / (f
    baseline) s.
    """
    depth_m = truth_m.copy()
    if spec.baseline_m:
        scale = np.float32(fx * spec.baseline_m)
        disparity_px = scale / truth_m
        lost = unseen_by_right_eye(disparity_px)
        if spec.edge_holes_px:
            lost |= near_jumps(disparity_px, spec.edge_holes_px)
        if spec.disparity_stddev_px:
            noise = generator.standard_normal(truth_m.shape, np.float32)
            noisy = disparity_px + np.float32(spec.disparity_stddev_px) * noise
            matched = (noisy > 0) & (disparity_px > 0)
            np.divide(scale, noisy, out=depth_m, where=matched)
            depth_m[~matched] = np.inf
        depth_m[lost] = np.nan
    depth_m[depth_m > np.float32(spec.max_range_m)] = np.inf
    depth_m[depth_m < np.float32(spec.min_range_m)] = -np.inf
    return depth_m


def unseen_by_right_eye(disparity_px: Reals) -> Flags:
    """Return the pixels of the left eye whose points the right eye does not see.

    A point appears in column x - disparity of the right eye. It is hidden if a point to its right
    in the left picture appears at least as far left, as a nearer point does. A band along the left
    rim of the left picture is outside of the right picture.
    """
    columns = np.arange(disparity_px.shape[1], dtype=np.float32)
    there = columns - disparity_px
    leftmost = np.minimum.accumulate(there[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(there.shape, bool)
    hidden[:, :-1] = leftmost[:, 1:] <= there[:, :-1]
    return hidden | (there < -0.5)


def near_jumps(disparity_px: Reals, radius_px: int) -> Flags:
    """Return the pixels within a square of half width `radius_px` around a disparity jump."""
    jumps = np.zeros(disparity_px.shape, np.uint8)
    across = np.abs(np.diff(disparity_px, axis=1)) > JUMP_PX
    down = np.abs(np.diff(disparity_px, axis=0)) > JUMP_PX
    jumps[:, 1:] |= across
    jumps[:, :-1] |= across
    jumps[1:] |= down
    jumps[:-1] |= down
    window = np.ones((2 * radius_px - 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(jumps, window)).astype(bool)
