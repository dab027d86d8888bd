# SPDX-License-Identifier: Apache-2.0
"""The URDF that is made from a model."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np
import pytest
from msgspec.structs import replace

from groundlink.frames import matrix_from_quaternion, quaternion_from_rpy
from groundlink.scenario import Scenario
from groundlink.world.solids import Box, Solid
from services.physics.urdf import urdf


@pytest.fixture
def robot(lab: Scenario) -> ElementTree.Element:
    return ElementTree.fromstring(urdf(lab.vehicles[0].model, lab.world.materials))


def numbers(element: ElementTree.Element | None, key: str) -> list[float]:
    assert element is not None
    return [float(word) for word in element.attrib[key].split()]


def test_it_weighs_what_the_model_says(robot: ElementTree.Element) -> None:
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


def test_wheels_are_spheres_to_touch_and_cylinders_to_look_at(robot: ElementTree.Element) -> None:
    wheel = robot.find("link[@name='front_left_wheel_link']")
    assert wheel is not None
    assert numbers(wheel.find("collision/geometry/sphere"), "radius") == [0.1651]
    assert numbers(wheel.find("visual/geometry/cylinder"), "length") == [0.1143]
    axle = robot.find("joint[@name='front_left_wheel']")
    assert axle is not None
    assert axle.attrib["type"] == "continuous"
    assert numbers(axle.find("axis"), "xyz") == [0, 1, 0]


def test_visuals_have_a_colour_each(robot: ElementTree.Element) -> None:
    defined = {material.attrib["name"] for material in robot.findall("material")}
    used = {material.attrib["name"] for material in robot.iterfind(".//visual/material")}
    assert used
    assert used <= defined


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, -0.7, 2.5), (-1.0, 1.2, -3.0)])
def test_turned_parts_stay_turned(lab: Scenario, rpy: tuple[float, float, float]) -> None:
    part = Solid(
        name="part",
        shape=Box(size_m=(1.0, 2.0, 3.0)),
        material="metal",
        orientation=quaternion_from_rpy(*rpy),
    )
    model = replace(lab.vehicles[0].model, visuals=(part,))
    origin = ElementTree.fromstring(urdf(model, lab.world.materials)).find("link/visual/origin")
    written = quaternion_from_rpy(*numbers(origin, "rpy"))
    np.testing.assert_allclose(
        matrix_from_quaternion(written), matrix_from_quaternion(part.orientation), atol=1e-12
    )
