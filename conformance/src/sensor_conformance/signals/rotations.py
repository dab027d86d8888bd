# SPDX-License-Identifier: Apache-2.0
"""Rotations as quaternions x, y, z, w in rows."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def normalized(quaternions: Floats) -> Floats:
    """Return quaternions of length 1; a zero quaternion becomes the identity."""
    length = np.linalg.norm(quaternions, axis=-1, keepdims=True)
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    divisor = np.where(length > 0, length, 1)
    return np.asarray(np.where(length > 0, quaternions / divisor, identity), np.float64)


def product(first: Floats, second: Floats) -> Floats:
    """Return first * second: the rotation that applies `second`, then `first`."""
    a, b = first[..., :3], second[..., :3]
    s, t = first[..., 3:], second[..., 3:]
    xyz = s * b + t * a + np.cross(a, b)
    w = s * t - np.sum(a * b, axis=-1, keepdims=True)
    return np.asarray(np.concatenate((xyz, w), axis=-1), np.float64)


def inverse(quaternions: Floats) -> Floats:
    """Return the inverse of unit quaternions."""
    return np.asarray(quaternions * np.array([-1.0, -1.0, -1.0, 1.0]), np.float64)


def rotate(quaternions: Floats, vectors: Floats) -> Floats:
    """Rotate vectors by unit quaternions."""
    axis, w = quaternions[..., :3], quaternions[..., 3:]
    across = 2 * np.cross(axis, vectors)
    return np.asarray(vectors + w * across + np.cross(axis, across), np.float64)


def yaw(quaternions: Floats) -> Floats:
    """Return the unwrapped heading in radians, counterclockwise about z."""
    x, y, z, w = np.moveaxis(quaternions, -1, 0)
    return np.asarray(
        np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))), np.float64
    )


def rates(seconds: Floats, quaternions: Floats) -> Floats:
    """Return angular velocities between successive orientations, rad/s in the body frame."""
    unit = normalized(quaternions)
    turn = product(inverse(unit[:-1]), unit[1:])
    turn = np.where(turn[:, 3:] < 0, -turn, turn)
    sine = np.linalg.norm(turn[:, :3], axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, turn[:, 3:])
    axis = turn[:, :3] / np.where(sine > 0, sine, 1)
    return np.asarray(axis * angle / np.diff(seconds)[:, None], np.float64)
