# SPDX-License-Identifier: Apache-2.0
"""Poses in the plane: arrays of x (m), y (m) and yaw (rad)."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def compose(a: Floats, b: Floats) -> Floats:
    """Return a_from_c of a_from_b and b_from_c; either may be several poses, shape (N, 3)."""
    cos, sin = np.cos(a[..., 2]), np.sin(a[..., 2])
    x = a[..., 0] + cos * b[..., 0] - sin * b[..., 1]
    y = a[..., 1] + sin * b[..., 0] + cos * b[..., 1]
    return np.stack([x, y, a[..., 2] + b[..., 2]], axis=-1)


def inverse(a: Floats) -> Floats:
    """Return b_from_a of a_from_b."""
    cos, sin = np.cos(a[2]), np.sin(a[2])
    return np.array([-cos * a[0] - sin * a[1], sin * a[0] - cos * a[1], -a[2]])


def transformed(a_from_b: Floats, points: Floats) -> Floats:
    """Return points of frame b, shape (N, 2), in frame a."""
    with_yaw = np.column_stack([points, np.zeros(len(points))])
    return compose(a_from_b, with_yaw)[:, :2]


def arc(speed_mps: float, turn_radps: float, seconds: Floats) -> Floats:
    """Return the poses, shape (N, 3), that a constant velocity reaches after some times."""
    half = 0.5 * turn_radps * seconds
    chord = speed_mps * seconds * np.sinc(half / np.pi)
    return np.column_stack([chord * np.cos(half), chord * np.sin(half), 2 * half])


def wrapped(angle: float) -> float:
    """Return an angle between -pi and pi."""
    return float(np.arctan2(np.sin(angle), np.cos(angle)))
