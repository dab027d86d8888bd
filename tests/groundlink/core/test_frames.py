# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from groundlink.core import frames

RANDOM = np.random.default_rng(1)
FIRST = Rotation.random(200, rng=RANDOM)
SECOND = Rotation.random(200, rng=RANDOM)


def same_rotation(quaternion: object, rotation: Rotation, tolerance: float = 1e-14) -> bool:
    """Compare as rotations: q and -q are the same."""
    products = np.sum(np.asarray(quaternion) * rotation.as_quat(), axis=-1)
    return bool(np.all(np.abs(np.abs(products) - 1) < tolerance))


@pytest.mark.parametrize(
    "rpy",
    [(0, 0, 0), (0.3, 0, 0), (0, 0.3, 0), (0, 0, 0.3), (0.1, -1.2, 3.0), (-3, math.pi / 2, 1)],
)
def test_quaternion_from_rpy_turns_about_fixed_axes(rpy: tuple[float, float, float]) -> None:
    quaternion = frames.quaternion_from_rpy(*rpy)
    assert same_rotation(quaternion, Rotation.from_euler("xyz", rpy))
    assert math.hypot(*quaternion) == pytest.approx(1, abs=1e-15)


def test_no_turn_is_exactly_the_identity() -> None:
    assert frames.quaternion_from_rpy(0, 0, 0) == frames.IDENTITY_QUATERNION
    assert (frames.matrix_from_quaternion(frames.IDENTITY_QUATERNION) == np.eye(3)).all()
    assert not frames.rotation_vector(frames.IDENTITY_QUATERNION).any()


def test_matrix_from_quaternion() -> None:
    quaternions = FIRST.as_quat()
    np.testing.assert_allclose(
        frames.matrix_from_quaternion(quaternions), FIRST.as_matrix(), atol=1e-15
    )
    stacked = frames.matrix_from_quaternion(quaternions.reshape(4, 50, 4))
    assert stacked.shape == (4, 50, 3, 3)
    assert (stacked.reshape(-1, 3, 3) == frames.matrix_from_quaternion(quaternions)).all()
    assert frames.matrix_from_quaternion(quaternions[0]).shape == (3, 3)


def test_multiply_chains_names() -> None:
    product = frames.multiply(FIRST.as_quat(), SECOND.as_quat())
    assert same_rotation(product, FIRST * SECOND)
    assert not same_rotation(product, SECOND * FIRST)
    one_with_many = frames.multiply(FIRST[0].as_quat(), SECOND.as_quat())
    assert same_rotation(one_with_many, FIRST[0] * SECOND)


def test_conjugate_is_the_inverse() -> None:
    assert same_rotation(frames.conjugate(FIRST.as_quat()), FIRST.inv())


def test_rotation_vector() -> None:
    quaternions = FIRST.as_quat()
    expected = FIRST.as_rotvec()
    np.testing.assert_allclose(frames.rotation_vector(quaternions), expected, atol=1e-13)
    np.testing.assert_allclose(frames.rotation_vector(-quaternions), expected, atol=1e-13)
    assert frames.rotation_vector(quaternions[0]).shape == (3,)


@pytest.mark.parametrize("angle", [1e-15, 1e-10, 1.9e-9, 2.1e-9, 1e-6, 1.0, math.pi - 1e-9])
def test_rotation_vector_of_a_known_angle(angle: float) -> None:
    quaternion = [0, math.sin(angle / 2), 0, math.cos(angle / 2)]
    np.testing.assert_allclose(frames.rotation_vector(quaternion), [0, angle, 0], rtol=1e-15)


@pytest.mark.parametrize("flipped", [1.0, -1.0])
def test_nlerp_is_near_slerp_within_a_tick(flipped: float) -> None:
    step = Rotation.from_rotvec([[0.0, 6 / 400, 0.0]])
    second = FIRST * step
    fractions = RANDOM.uniform(size=200)
    mixed = frames.nlerp(FIRST.as_quat(), flipped * second.as_quat(), fractions)
    expected = FIRST * Rotation.from_rotvec(step.as_rotvec() * fractions[:, None])
    assert (expected.inv() * Rotation.from_quat(mixed)).magnitude().max() < 1e-7
    np.testing.assert_allclose(np.linalg.norm(mixed, axis=1), 1, atol=1e-15)


def test_nlerp_takes_the_middle_and_keeps_the_ends() -> None:
    first, second = FIRST.as_quat(), SECOND.as_quat()
    for fraction, rotation in ((0.0, FIRST), (1.0, SECOND)):
        assert same_rotation(frames.nlerp(first, second, np.full(200, fraction)), rotation)
    for i in range(5):
        middle = Slerp([0, 1], Rotation.concatenate([FIRST[i], SECOND[i]]))(0.5)
        assert same_rotation(frames.nlerp(first[i], second[i], np.array(0.5)), middle)


def test_rpy_from_matrix_turns_back_quaternion_from_rpy() -> None:
    for angles in RANDOM.uniform((-3, -1.5, -3), (3, 1.5, 3), (200, 3)):
        matrix = frames.matrix_from_quaternion(frames.quaternion_from_rpy(*angles))
        np.testing.assert_allclose(frames.rpy_from_matrix(matrix), angles, atol=1e-9)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
def test_rpy_from_matrix_where_x_is_upright(pitch: float) -> None:
    given = frames.matrix_from_quaternion(frames.quaternion_from_rpy(0.4, pitch, 1.0))
    angles = frames.rpy_from_matrix(given)
    again = frames.matrix_from_quaternion(frames.quaternion_from_rpy(*angles))
    np.testing.assert_allclose(again, given, atol=1e-12)


def test_transform_maps_points() -> None:
    positions, points = RANDOM.normal(size=(2, 200, 3))
    world_from_body = frames.transform(positions, FIRST.as_quat())
    assert world_from_body.shape == (200, 4, 4)
    in_body = np.concatenate([points, np.ones((200, 1))], axis=1)
    in_world = (world_from_body @ in_body[..., None])[..., 0]
    np.testing.assert_allclose(in_world[:, :3], FIRST.apply(points) + positions, atol=1e-14)
    assert (in_world[:, 3] == 1).all()
    assert frames.transform((1, 2, 3), frames.IDENTITY_QUATERNION).tolist() == [
        [1, 0, 0, 1],
        [0, 1, 0, 2],
        [0, 0, 1, 3],
        [0, 0, 0, 1],
    ]
