# SPDX-License-Identifier: Apache-2.0
"""Hulls of meshes that move."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.scenario.schema import Placement
from groundlink.world import assets
from groundlink.world.mesh_asset import asset_of
from groundlink.world.solids import Mesh, Solid
from services.physics.vehicle.hull import DIRECTIONS, hull
from tests.services.physics.grounds import drive, put, shipped, wall_clock

CORNERS = np.array(list(product((0.0, 2.0), (-0.2, 0.2), (0.1, 0.3))), np.float32)


def vertices(text: str) -> np.ndarray:
    return np.array([line.split()[1:] for line in text.splitlines() if line[0] == "v"], np.float64)


def test_a_box_is_its_eight_corners() -> None:
    inside = np.random.default_rng(0).uniform((0, -0.2, 0.1), (2, 0.2, 0.3), (500, 3))
    found = vertices(hull(np.concatenate([inside.astype(np.float32), CORNERS])))
    assert {tuple(v) for v in found} == {tuple(v) for v in CORNERS.astype(np.float64)}


def test_a_ball_of_many_vertices_becomes_one_of_few_that_is_as_large() -> None:
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    found = vertices(hull(points.astype(np.float32)))
    assert len(found) <= DIRECTIONS + 6
    assert np.ptp(found, axis=0) == pytest.approx([2.0, 2.0, 2.0], abs=0.01)


def test_a_vehicle_stops_where_its_mesh_meets_the_wall() -> None:
    digest = assets.keep(asset_of(CORNERS, np.array([[0, 1, 2], [5, 6, 7]], np.uint32)))
    ram = Solid("ram", Mesh(asset=digest, low_m=(0, -0.2, 0.1), high_m=(2, 0.2, 0.3)), "ground")
    model = replace(shipped("rover"), collisions=(ram,))
    with put(model, wall_clock(3.0), at=Placement(x_m=-0.5)) as simulation:
        driven = drive(simulation, 5.0, (0.5, 0.0))
    assert driven.pose[:, 0].max() == pytest.approx(1.0, abs=0.02)
