# SPDX-License-Identifier: Apache-2.0
"""Lens distortion in both directions: plumb_bob and equidistant of sensor_msgs.

Points are on the plane z = 1, shape (N, 2): where rays pass it, or picture points before K is
applied. The formulas are those of OpenCV's `calib3d` and `fisheye`, so calibration with OpenCV or
ROS finds the same numbers.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from groundlink.core.errors import UserError
from groundlink.core.frames import Floats
from groundlink.scenario import cameras
from groundlink.scenario.cameras import Optics
from services.sensors.rendering.gl.pinhole import Pinhole

MAX_FIELD_DEG = 150.0
"""Widest field of view that is drawn, in degrees: at 180 degrees the plane z = 1 extends to
infinity."""

EDGE = math.radians(MAX_FIELD_DEG / 2)
ITERATIONS = 100


class Model(NamedTuple):
    """One lens model."""

    radius: Callable[[float], float]
    """Distance from the center for an angle off the axis, with all coefficients at 0."""

    bent: Callable[[Floats, Floats], Floats]
    """Distort: from ray points and coefficients to picture points."""

    straight: Callable[[Floats, Floats], Floats]
    """Undistort. Points that no ray reaches, or a ray beyond `MAX_FIELD_DEG`, are NaN."""


def _plumb_bob(points: Floats, coefficients: Floats) -> Floats:
    k1, k2, p1, p2, k3 = coefficients
    x, y = points.T
    squared = x * x + y * y
    radial = 1 + squared * (k1 + squared * (k2 + squared * k3))
    return np.stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (squared + 2 * x * x),
            y * radial + p1 * (squared + 2 * y * y) + 2 * p2 * x * y,
        ],
        axis=1,
    )


def _from_plumb_bob(points: Floats, coefficients: Floats) -> Floats:
    stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ITERATIONS, 1e-9)
    found = cv2.undistortPoints(points[:, None], np.eye(3), coefficients, criteria=stop)
    straight = np.asarray(found[:, 0], np.float64)
    missed = np.linalg.norm(_plumb_bob(straight, coefficients) - points, axis=1)
    field = np.linalg.norm(straight, axis=1)
    straight[~(missed < 1e-5) | ~(field < math.tan(EDGE))] = np.nan
    return straight


def _theta_d(theta: NDArray[np.float64], coefficients: ArrayLike) -> NDArray[np.float64]:
    k1, k2, k3, k4 = np.asarray(coefficients)
    s = theta * theta
    return np.asarray(theta * (1 + s * (k1 + s * (k2 + s * (k3 + s * k4)))))


def _equidistant(points: Floats, coefficients: Floats) -> Floats:
    radius = np.linalg.norm(points, axis=1, keepdims=True)
    scale = _theta_d(np.arctan(radius), coefficients) / np.maximum(radius, 1e-12)
    return np.where(radius > 1e-12, points * scale, points)


def _from_equidistant(points: Floats, coefficients: Floats) -> Floats:
    # A table of the angle over the radius, up to where the radius stops growing.
    theta = np.linspace(0.0, EDGE, 20001)
    radii = _theta_d(theta, coefficients)
    rising = np.flatnonzero(np.diff(radii) <= 0)
    last = int(rising[0]) if len(rising) else len(theta) - 1
    radius = np.linalg.norm(points, axis=1)
    found = np.interp(radius, radii[: last + 1], theta[: last + 1], right=np.nan)
    scale = np.tan(found) / np.maximum(radius, 1e-12)
    return np.where(radius[:, None] > 1e-12, points * scale[:, None], points)


MODELS = {
    "plumb_bob": Model(math.tan, _plumb_bob, _from_plumb_bob),
    "equidistant": Model(float, _equidistant, _from_equidistant),
}
"""Lens models by their names in sensor_msgs/distortion_models."""


def lens_pinhole(spec: Optics) -> Pinhole:
    """Return the size of a camera's picture, and K."""
    return Pinhole.of(spec, radius=MODELS[spec.lens.model].radius)


def slopes(spec: cameras.Lens, pinhole: Pinhole, scale: float = 1.0) -> Floats:
    """Return where pixels' rays pass the plane z = 1, shape (height, width, 2); NaN for none.

    Parameters
    ----------
    scale
        Size of this color's picture relative to green.

    Raises
    ------
    UserError
        If the lens can't be drawn.
    """
    if scale == 1 and spec.is_straight:
        return pinhole.rays()[..., :2]
    model, coefficients = MODELS[spec.model], np.array(spec.coefficients)
    points = np.ascontiguousarray(pinhole.rays()[..., :2] / scale).reshape(-1, 2)
    rays = model.straight(points, coefficients).reshape(pinhole.height, pinhole.width, 2)
    row, column = _nearest(pinhole)
    # The circle of a fisheye may end inside the picture, but not before the middle of its edges.
    must = rays if spec.model == "plumb_bob" else np.concatenate([rays[row], rays[:, column]])
    if np.isnan(must).any():
        raise UserError(
            f"lens: `{spec.model}` with {', '.join(map(str, spec.coefficients))} sees beyond "
            f"{MAX_FIELD_DEG:g} degrees or folds back within the picture. Fix: "
            "reduce the field of view or the coefficients"
        )
    return rays


def _nearest(pinhole: Pinhole) -> tuple[int, int]:
    """Return row and column of the pixel nearest to the principal point."""
    row = min(max(round(pinhole.cy), 0), pinhole.height - 1)
    return row, min(max(round(pinhole.cx), 0), pinhole.width - 1)
