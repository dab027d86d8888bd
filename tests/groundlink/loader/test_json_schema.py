# SPDX-License-Identifier: Apache-2.0
"""The schemas that editors get agree with what is shipped and with what `load` refuses."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from groundlink.loader.json_schema import KINDS, json_schema
from groundlink.loader.scenario_files import SHIPPED
from tests.groundlink.loader.urdf.carts import MODEL
from tools import json_schemas

FOLDERS = {"": "scenario", "worlds": "world", "vehicles": "vehicle", "sensors": "datasheet"}
FILES = [
    (kind, file)
    for folder, kind in FOLDERS.items()
    for file in sorted((SHIPPED / folder).glob("*.yaml"))
]
LAB = SHIPPED / "indoor_lab.yaml"


def test_the_shipped_schemas_are_those_of_the_types() -> None:
    shipped = {file: file.read_text(encoding="utf-8") for file in json_schemas.FOLDER.iterdir()}
    assert shipped == json_schemas.files(), "run: python -m tools.json_schemas"


def named_schema(file: Path) -> Path:
    """Return the schema that a file names for editors."""
    (name,) = re.findall(r"^# yaml-language-server: \$schema=(.*)$", file.read_text(), re.MULTILINE)
    return (file.parent / name).resolve()


@pytest.mark.parametrize(("kind", "file"), FILES, ids=lambda given: getattr(given, "stem", given))
def test_a_shipped_file_names_its_schema(kind: str, file: Path) -> None:
    assert named_schema(file) == json_schemas.FOLDER / f"{kind}.json"


def mistakes(kind: str, value: Any) -> list[str]:
    return [
        error.message
        for error in jsonschema.Draft202012Validator(json_schema(kind)).iter_errors(value)
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_is_one(kind: str) -> None:
    jsonschema.Draft202012Validator.check_schema(json_schema(kind))


def properties(part: Any, path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield all properties of a schema with their paths."""
    members = part.items() if isinstance(part, dict) else enumerate(part)
    for key, member in members:
        if key == "properties":
            yield from ((f"{path}/{name}", node) for name, node in member.items())
        if isinstance(member, dict | list):
            yield from properties(member, f"{path}/{key}")


@pytest.mark.parametrize("kind", KINDS)
def test_every_property_has_a_description(kind: str) -> None:
    found = list(properties(json_schema(kind)))
    assert len(found) > 1000
    assert [path for path, node in found if not node.get("description", "").strip()] == []


@pytest.mark.parametrize(
    ("struct", "field", "text"),
    [
        ("Time", "clock_rate_hz", "Messages on `/clock` per second of sim time."),
        ("Lidar", "dropout", "Share of returns that are dropped at random."),
        ("LidarSheet", "dropout", "Share of returns that are dropped at random."),
        ("Lidar", "kind", "`lidar`: A spinning 3D LiDAR."),
        ("Vehicle", "route", "Route of the autopilot; none: the vehicle waits for commands."),
    ],
)
def test_a_description_is_the_docstring_of_the_field(struct: str, field: str, text: str) -> None:
    definition = json_schema("scenario")["$defs"][struct]
    assert definition["properties"][field]["description"] == text


@pytest.mark.parametrize(("kind", "file"), FILES, ids=lambda given: getattr(given, "stem", given))
def test_what_is_shipped_fits(kind: str, file: Path) -> None:
    assert not mistakes(kind, yaml.safe_load(file.read_text()))


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("vehicles", 0, "naem"), "rover"),
        (("vehicles", 0, "placement", "x_m"), "here"),
        (("vehicles", 0, "sensors", 0, "mount"), 3),
        (("vehicles", 0, "sensors", 2, "kind"), "encoder"),
        (("vehicles", 0, "sensors", 2, "ticks_per_revolution"), 0),
        (("seed",), -1),
        (("world",), 7),
    ],
)
def test_a_mistake_is_one(path: tuple[str | int, ...], value: object) -> None:
    scenario = yaml.safe_load(LAB.read_text())
    part = scenario
    for step in path[:-1]:
        part = part[step]
    part[path[-1]] = value
    assert mistakes("scenario", scenario)


def test_only_a_data_sheet_lets_fields_be_left_out() -> None:
    scenario = yaml.safe_load(LAB.read_text())
    (lidar, *_) = scenario["vehicles"][0]["sensors"]
    del lidar["datasheet"]
    assert mistakes("scenario", scenario)


def test_a_vehicle_may_name_a_urdf() -> None:
    cart = yaml.safe_load(MODEL)
    assert not mistakes("vehicle", cart)
    cart["wheels"]["left_wheel_joint"]["fricton"] = 1
    assert mistakes("vehicle", cart)
