# SPDX-License-Identifier: Apache-2.0
"""The URDF that a stack gets of each shipped vehicle."""

import math
from functools import cache
from xml.etree import ElementTree

import numpy as np
import pytest

from groundlink.core.frames import quaternion_from_rpy, transform
from groundlink.loader import load
from groundlink.messages.navigation import Text
from groundlink.ros.base import Base
from groundlink.ros.cdr import to_cdr
from groundlink.ros.streams import mounts
from groundlink.scenario.schema import Vehicle

Element = ElementTree.Element
ROWS = [("indoor_lab", 0), ("indoor_paper", 0), ("outdoor_paper", 0), ("two_rovers", 1)]


@cache
def described(name: str, place: int) -> tuple[Vehicle, Element]:
    scenario = load(name)
    vehicle = scenario.vehicles[place]
    return vehicle, ElementTree.fromstring(Base(scenario, vehicle, "r").description)


def numbers(element: Element | None, name: str) -> list[float]:
    assert element is not None
    return [float(word) for word in element.attrib[name].split()]


@pytest.mark.parametrize(("name", "place"), ROWS)
def test_links_are_a_tree_below_the_base(name: str, place: int) -> None:
    vehicle, robot = described(name, place)
    links = [link.attrib["name"] for link in robot.findall("link")]
    parents = {}
    for joint in robot.findall("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        assert parent is not None
        assert child is not None
        parents[child.attrib["link"]] = parent.attrib["link"]
    assert len(set(links)) == len(links)
    assert {*links} == {*parents, vehicle.model.base_frame}
    carriers = {f"{joint.parent}_link" for joint in vehicle.model.joints if joint.parent}
    assert {*parents.values()} == {vehicle.model.base_frame} | carriers
    assert robot.find("link/visual") is not None
    for element in robot.iter():
        for word in (w for value in element.attrib.values() for w in value.split()):
            assert word not in ("nan", "inf")


@pytest.mark.parametrize(("name", "place"), ROWS)
def test_sensors_are_placed_as_in_tf(name: str, place: int) -> None:
    vehicle, robot = described(name, place)
    for mount in mounts(vehicle, 0):
        origin = robot.find(f"joint[@name='{mount.child}_joint']/origin")
        roll, pitch, yaw = numbers(origin, "rpy")
        there = transform(numbers(origin, "xyz"), quaternion_from_rpy(roll, pitch, yaw))
        np.testing.assert_allclose(there, transform(mount.translation_m, mount.rotation), atol=1e-8)


def test_a_wheel_lies_on_its_axle() -> None:
    vehicle, robot = described("outdoor_paper", 0)
    wheel = vehicle.model.wheels[0]
    collision = robot.find(f"link[@name='{wheel.name}_link']/collision")
    assert collision is not None
    assert numbers(collision.find("origin"), "rpy")[0] == pytest.approx(math.pi / 2)
    assert numbers(collision.find("geometry/cylinder"), "radius") == [wheel.radius_m]


def test_it_travels_as_a_string() -> None:
    scenario = load("indoor_lab")
    text = Base(scenario, scenario.vehicles[0], "r").description
    assert text.encode() in bytes(to_cdr(Text(1, text)))
