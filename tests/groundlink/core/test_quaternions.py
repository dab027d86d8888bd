# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from groundlink.core import frames, quaternions
from groundlink.core.fields import Quaternion, Vector3

RANDOM = np.random.default_rng(3)
UNIT: list[Quaternion] = [
    (x, y, z, w) for x, y, z, w in Rotation.random(50, rng=RANDOM).as_quat().tolist()
]
UNIT += [(0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0), (0.0, -0.6, 0.8, 0.0)]


@pytest.mark.parametrize(("first", "second"), [*zip(UNIT, reversed(UNIT), strict=True)])
def test_they_agree_with_the_vectorised_ones(first: Quaternion, second: Quaternion) -> None:
    x, y, z = RANDOM.normal(size=3).tolist()
    vector: Vector3 = (x, y, z)
    turn = frames.rotation_vector(first)
    assert quaternions.conjugate(first) == tuple(frames.conjugate(first))
    for found, expected, off in (
        (quaternions.multiply(first, second), frames.multiply(first, second), 1e-15),
        (quaternions.rotate(first, vector), frames.matrix_from_quaternion(first) @ vector, 1e-14),
        (quaternions.rotation_vector(first), turn, 1e-14),
        (quaternions.rotation_vector(quaternions.half_of(first)), turn / 2, 1e-14),
    ):
        np.testing.assert_allclose(found, expected, atol=off)
    forward = frames.matrix_from_quaternion(first)[:, 0]
    assert quaternions.heading_rad(first) == math.atan2(forward[1], forward[0])


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-160, 1e-12, 1e-5, 0.1, 3.0, math.pi])
def test_rotation_vectors_go_both_ways(angle: float) -> None:
    vector = (0.6 * angle, 0.0, -0.8 * angle)
    quaternion = quaternions.from_rotation_vector(vector)
    np.testing.assert_allclose(quaternion, Rotation.from_rotvec(vector).as_quat(), atol=1e-16)
    back = quaternions.rotation_vector(quaternion)
    np.testing.assert_allclose(back, vector, rtol=1e-14, atol=1e-150)


def test_no_rotation_is_exactly_none() -> None:
    assert quaternions.from_rotation_vector((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0, 1.0)
    assert quaternions.rotation_vector((0.0, 0.0, 0.0, 1.0)) == (0.0, 0.0, 0.0)
