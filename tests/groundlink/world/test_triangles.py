# SPDX-License-Identifier: Apache-2.0
"""Triangles of shapes: closed, wound outwards, in place, and near enough to the true surface."""

import numpy as np
import pytest

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.world.solids import Box, Cylinder, Shape, Solid, Sphere
from groundlink.world.triangles import Triangles, merged

SHAPES: list[tuple[Shape, float]] = [
    (Box(size_m=(1.0, 2.0, 3.0)), 6.0),
    (Cylinder(radius_m=0.3, length_m=0.5), np.pi * 0.3**2 * 0.5),
    (Sphere(radius_m=0.4), 4 / 3 * np.pi * 0.4**3),
]
PLACE = {"position_m": (1.0, -2.0, 3.0), "orientation": quaternion_from_rpy(0.3, -0.4, 2.0)}


def corners(mesh: Triangles) -> np.ndarray:
    return mesh.vertices[mesh.faces].astype(np.float64)


def volume(mesh: Triangles) -> float:
    """Signed: negative if the winding is inwards (divergence theorem)."""
    a, b, c = np.moveaxis(corners(mesh), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


@pytest.mark.parametrize(("shape", "true_volume"), SHAPES)
def test_surface_is_closed_and_wound_outwards(shape: Shape, true_volume: float) -> None:
    mesh = merged([Solid(name="a", shape=shape, material="m", **PLACE)])
    edges = [tuple(face[[i, (i + 1) % 3]]) for face in mesh.faces for i in range(3)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    # Inscribed, so a little less than the true volume.
    assert 0.97 * true_volume < volume(mesh) < true_volume * (1 + 1e-5)


@pytest.mark.parametrize(("shape", "_"), SHAPES)
def test_no_triangle_is_flat(shape: Shape, _: float) -> None:
    a, b, c = np.moveaxis(corners(merged([Solid(name="a", shape=shape, material="m")])), 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 1e-4


def test_box_is_exact_and_in_place() -> None:
    mesh = merged([Solid(name="a", shape=Box(size_m=(1.0, 2.0, 3.0)), material="m", **PLACE)])
    rotation = matrix_from_quaternion(PLACE["orientation"])
    local = (mesh.vertices - np.array(PLACE["position_m"])) @ rotation
    np.testing.assert_allclose(np.abs(local), np.tile([0.5, 1.0, 1.5], (8, 1)), atol=1e-6)


def test_wheel_is_within_a_centimeter() -> None:
    mesh = merged([Solid(name="a", shape=Cylinder(radius_m=0.2, length_m=0.1), material="m")])
    side = [face for face in corners(mesh) if len({round(z, 6) for z in face[:, 2]}) == 2]
    middles = np.mean(side, axis=1)
    assert np.all(np.hypot(middles[:, 0], middles[:, 1]) > 0.19)
    np.testing.assert_allclose(np.hypot(*mesh.vertices[1:-1, :2].T), 0.2, atol=1e-7)
    assert set(np.round(mesh.vertices[:, 2], 6)) == {np.float32(-0.05), np.float32(0.05)}


def test_sphere_is_within_a_centimeter() -> None:
    mesh = merged([Solid(name="a", shape=Sphere(radius_m=0.4), material="m")])
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 0.4, atol=1e-6)
    assert np.linalg.norm(corners(mesh).mean(axis=1), axis=1).min() > 0.39


def test_merged_keeps_apart_what_it_joins() -> None:
    solids = [Solid(name=str(i), shape=shape, material="m") for i, (shape, _) in enumerate(SHAPES)]
    one_by_one = [merged([solid], first_label=7 + i) for i, solid in enumerate(solids)]
    mesh = merged(solids, first_label=7)
    np.testing.assert_array_equal(mesh.labels, np.concatenate([m.labels for m in one_by_one]))
    np.testing.assert_array_equal(corners(mesh), np.concatenate([corners(m) for m in one_by_one]))


def test_nothing_is_a_surface_too() -> None:
    mesh = merged([])
    assert mesh.vertices.shape == (0, 3)
    assert mesh.faces.shape == (0, 3)
    assert mesh.labels.shape == (0,)
