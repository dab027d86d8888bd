# SPDX-License-Identifier: Apache-2.0
"""The URDF that is made from a model."""

from itertools import product
from xml.etree import ElementTree

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.core.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.scenario import Scenario
from groundlink.scenario.schema import Placement
from groundlink.world import assets
from groundlink.world.mesh_asset import encode_mesh
from groundlink.world.solids import Box, Mesh, Solid
from services.physics.trials.track import drive, put
from services.physics.vehicle.urdf import HULL_DIRECTIONS, convex_hull, urdf
from tests.services.physics.grounds import shipped, wall


@pytest.fixture
def robot(lab: Scenario) -> ElementTree.Element:
    return ElementTree.fromstring(urdf(lab.vehicles[0].model))


def numbers(element: ElementTree.Element | None, key: str) -> list[float]:
    assert element is not None
    return [float(word) for word in element.attrib[key].split()]


def test_mass_matches_the_model(robot: ElementTree.Element) -> None:
    masses = [float(mass.attrib["value"]) for mass in robot.iter("mass")]
    assert sum(masses) == pytest.approx(55.0, abs=0.5)
    assert all(mass > 0 for mass in masses)


def test_it_is_one_tree_with_the_models_links(robot: ElementTree.Element, lab: Scenario) -> None:
    links = [link.attrib["name"] for link in robot.findall("link")]
    children = [child.attrib["link"] for child in robot.iter("child")]
    parents = [parent.attrib["link"] for parent in robot.iter("parent")]
    assert len(set(links)) == len(links)
    assert set(lab.vehicles[0].model.link_names()) <= set(links)
    assert set(links) - set(children) == {"base_link"}
    assert len(children) == len(set(children))
    assert set(parents) <= set(links)


def test_every_inertia_is_one_that_a_body_can_have(robot: ElementTree.Element) -> None:
    for inertia in robot.iter("inertia"):
        x, y, z = sorted(float(inertia.attrib[key]) for key in ("ixx", "iyy", "izz"))
        assert 0 < x <= y <= z <= x + y + 1e-12


def test_a_geared_wheel_is_none_that_bullet_takes_for_a_mistake(lab: Scenario) -> None:
    model = lab.vehicles[0].model
    wheels = tuple(replace(wheel, inertia_kgm2=1.0) for wheel in model.wheels)
    test_every_inertia_is_one_that_a_body_can_have(
        ElementTree.fromstring(urdf(replace(model, wheels=wheels)))
    )


def test_wheels_are_balls_that_slide_upwards(robot: ElementTree.Element) -> None:
    wheel = robot.find("link[@name='front_left_wheel_link']")
    assert wheel is not None
    assert numbers(wheel.find("collision/geometry/sphere"), "radius") == [0.1651]
    slide = robot.find("joint[@name='front_left_wheel_suspension']")
    assert slide is not None
    assert slide.attrib["type"] == "prismatic"
    assert numbers(slide.find("axis"), "xyz") == [0, 0, 1]
    assert numbers(slide.find("limit"), "upper") == [0.06]


def test_inertia_is_the_boxs_unless_it_has_its_own(lab: Scenario) -> None:
    model = lab.vehicles[0].model
    own = replace(model, chassis=replace(model.chassis, inertia_kgm2=(1.0, 2.0, 2.5)))
    for each, expected in ((model, 44.45 * (0.69**2 + 0.26**2) / 12), (own, 1.0)):
        inertia = ElementTree.fromstring(urdf(each)).find("link/inertial/inertia")
        assert numbers(inertia, "ixx") == pytest.approx([expected])


def test_a_box_that_does_not_collide_is_left_out(lab: Scenario) -> None:
    model = lab.vehicles[0].model
    hollow = replace(model, chassis=replace(model.chassis, collides=False))
    base = ElementTree.fromstring(urdf(hollow)).find("link")
    assert base is not None
    assert [part.tag for part in base.iterfind("collision/geometry/*")] == ["cylinder"]


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, -0.7, 2.5), (-1.0, 1.2, -3.0)])
def test_turned_parts_stay_turned(lab: Scenario, rpy: tuple[float, float, float]) -> None:
    part = Solid(
        name="part",
        shape=Box(size_m=(1.0, 2.0, 3.0)),
        material="metal",
        orientation=quaternion_from_rpy(*rpy),
    )
    model = replace(lab.vehicles[0].model, collisions=(part,))
    origin = ElementTree.fromstring(urdf(model)).findall("link/collision/origin")[1]
    written = quaternion_from_rpy(*numbers(origin, "rpy"))
    np.testing.assert_allclose(
        matrix_from_quaternion(written), matrix_from_quaternion(part.orientation), atol=1e-12
    )


CORNERS = np.array(list(product((0.0, 2.0), (-0.2, 0.2), (0.1, 0.3))), np.float32)


def vertices(text: str) -> np.ndarray:
    return np.array([line.split()[1:] for line in text.splitlines() if line[0] == "v"], np.float64)


def test_a_box_is_its_eight_corners() -> None:
    inside = np.random.default_rng(0).uniform((0, -0.2, 0.1), (2, 0.2, 0.3), (500, 3))
    found = vertices(convex_hull(np.concatenate([inside.astype(np.float32), CORNERS])))
    assert {tuple(v) for v in found} == {tuple(v) for v in CORNERS.astype(np.float64)}


def test_a_ball_of_many_vertices_becomes_one_of_few_that_is_as_large() -> None:
    points = np.random.default_rng(0).normal(size=(20_000, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    found = vertices(convex_hull(points.astype(np.float32)))
    assert len(found) <= HULL_DIRECTIONS + 6
    assert np.ptp(found, axis=0) == pytest.approx([2.0, 2.0, 2.0], abs=0.01)


def test_a_vehicle_stops_where_its_mesh_meets_the_wall() -> None:
    digest = assets.put(encode_mesh(CORNERS, np.array([[0, 1, 2], [5, 6, 7]], np.uint32)))
    ram = Solid("ram", Mesh(asset=digest, low_m=(0, -0.2, 0.1), high_m=(2, 0.2, 0.3)), "ground")
    model = replace(shipped("rover"), collisions=(ram,))
    with put(model, wall(3.0), at=Placement(x_m=-0.5)) as simulation:
        driven = drive(simulation, 5.0, (0.5, 0.0))
    assert driven.pose[:, 0].max() == pytest.approx(1.0, abs=0.02)
