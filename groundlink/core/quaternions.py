# SPDX-License-Identifier: Apache-2.0
"""Quaternion operations on single values, for what is computed 400 times a second.

Rule: the conventions of `groundlink.core.frames` (xyzw, unit length, names chain) on plain floats:
for one value a numpy call costs ten times as much as the arithmetic. Arrays belong to `frames`.
"""

from __future__ import annotations

import math

from groundlink.core.fields import Quaternion, Vector3

SMALL_SINE = 1e-150
"""Below it a squared component underflows; the rotation is none."""


def multiply(a_from_b: Quaternion, b_from_c: Quaternion) -> Quaternion:
    """Return a_from_c."""
    ax, ay, az, aw = a_from_b
    bx, by, bz, bw = b_from_c
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def conjugate(a_from_b: Quaternion) -> Quaternion:
    """Return b_from_a."""
    x, y, z, w = a_from_b
    return -x, -y, -z, w


def rotate(a_from_b: Quaternion, vector_in_b: Vector3) -> Vector3:
    """Return vector_in_a: v + 2 w (q x v) + 2 q x (q x v)."""
    x, y, z, w = a_from_b
    vx, vy, vz = vector_in_b
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    return (
        vx + w * tx + (y * tz - z * ty),
        vy + w * ty + (z * tx - x * tz),
        vz + w * tz + (x * ty - y * tx),
    )


def rotation_vector(a_from_b: Quaternion) -> Vector3:
    """Return axis times angle in radians, the angle in [0, pi]: the logarithm map of SO(3).

    By 2 atan2(sine, cosine) of the half angle, which is exact to rounding for small angles too.
    """
    x, y, z, w = a_from_b
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < SMALL_SINE:
        return 0.0, 0.0, 0.0
    scale = 2 * math.atan2(math.copysign(sine, w), abs(w)) / sine
    return x * scale, y * scale, z * scale


def half_of(a_from_b: Quaternion) -> Quaternion:
    """Return the unit quaternion of half the turn, the short way around."""
    x, y, z, w = a_from_b
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    w += 1
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return x / norm, y / norm, z / norm, w / norm


def from_rotation_vector(vector: Vector3) -> Quaternion:
    """Return the unit quaternion of a turn about `vector` by its length in radians."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(angle / 2) / angle if angle >= SMALL_SINE else 0.5
    return x * scale, y * scale, z * scale, math.cos(angle / 2)
