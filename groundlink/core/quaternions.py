# SPDX-License-Identifier: Apache-2.0
"""Quaternion operations on single values, for code that runs 400 times a second.

The conventions are those of `groundlink.core.frames`, on plain floats: for one value, a numpy call
costs ten times as much as the arithmetic.
"""

import math

from groundlink.core.fields import Quaternion, Vector3

SMALL_SINE = 1e-150
"""Below this a squared component underflows; the rotation is treated as zero."""


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


def heading_rad(world_from_body: Quaternion) -> float:
    """Return the yaw: the angle from x to the body's x axis in the plane, counterclockwise."""
    x, y, z, w = world_from_body
    return math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


def rotation_vector(a_from_b: Quaternion) -> Vector3:
    """Return axis times angle in radians, the angle in [0, pi]: the logarithm map of SO(3).

    Uses 2 atan2(sine, cosine) of the half angle, exact to rounding at small angles too.
    """
    x, y, z, w = a_from_b
    sine = math.sqrt(x * x + y * y + z * z)
    if sine < SMALL_SINE:
        return 0.0, 0.0, 0.0
    scale = 2 * math.atan2(math.copysign(sine, w), abs(w)) / sine
    return x * scale, y * scale, z * scale


def half_of(a_from_b: Quaternion) -> Quaternion:
    """Return the unit quaternion of half the rotation, on the shorter arc."""
    x, y, z, w = a_from_b
    if w < 0:
        x, y, z, w = -x, -y, -z, -w
    w += 1
    norm = math.sqrt(x * x + y * y + z * z + w * w)
    return x / norm, y / norm, z / norm, w / norm


def from_rotation_vector(vector: Vector3) -> Quaternion:
    """Return the unit quaternion of a rotation about `vector` by its length in radians."""
    x, y, z = vector
    angle = math.sqrt(x * x + y * y + z * z)
    scale = math.sin(angle / 2) / angle if angle >= SMALL_SINE else 0.5
    return x * scale, y * scale, z * scale, math.cos(angle / 2)
