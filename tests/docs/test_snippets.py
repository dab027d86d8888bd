# SPDX-License-Identifier: Apache-2.0
"""Every YAML block of a document is valid as the part of a scenario that it is."""

import re
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from groundlink.__main__ import main
from groundlink.loader.json_schema import json_schema

from .blocks import DOCS, ROOT, Block, blocks
from .test_commands import PAGES

ODOMETRY = [
    {"kind": "encoders", "name": "wheels", "topic": "/wheels", "frame": "base_link"},
    {
        "kind": "wheel_odometry",
        "name": "moved",
        "encoders": "wheels",
        "topic": "/odom",
        "frame": "odom",
    },
]
SCENARIO = {
    "name": "minimal",
    "world": "yard",
    "vehicles": [{"name": "rover", "model": "rover", "sensors": ODOMETRY}],
}
"""Scenario that parts are merged into: under the open sky, with the topics of the pages."""

WRITTEN_BY_COMMANDS = ("hills.yaml", "lab_world.yaml")
"""World files that a command of the page writes."""

DEFINITIONS = json_schema("scenario")["$defs"]
SHEETS = [schema["$ref"].rpartition("/")[2] for schema in json_schema("datasheet")["anyOf"]]
DEFINITIONS |= json_schema("datasheet")["$defs"]
FILES = ("World", "VehicleModel", "HillsTerrain", *SHEETS)
"""Types of other files and of their sections; their parts are checked field by field."""

_WRITTEN = re.compile(r"[Ww]rite\s+`([\w./]+\.yaml)`[^`]*```yaml\n$")
"""Text before a block that the reader writes to a file."""


def fields(name: str) -> dict[str, Any]:
    """Return the schema of each field of a type; of alternatives, that of any."""
    schema = DEFINITIONS[name]
    found: dict[str, Any] = {}
    for alternative in schema.get("anyOf", [schema]):
        for field, described in alternative.get("properties", {}).items():
            found.setdefault(field, {"anyOf": []})["anyOf"].append(described)
    return found


def value_of(block: Block) -> Any:
    """Return the value of a YAML block without its `...`; None if it is none of a scenario."""
    without_dots = re.sub(r",? *\.\.\.(?=[}\]])", "", block.text)
    try:
        value = yaml.safe_load(without_dots)
    except yaml.YAMLError:
        value = None
    is_one = merged(value) is not None or part_of(value) is not None
    if block.language == "indented" and isinstance(value, dict):  # Not a log line of a process.
        is_one = is_one and any(isinstance(part, dict | list) for part in value.values())
    assert is_one or block.language != "yaml", f"{block}: YAML of no file of Groundlink"
    return value if is_one else None


def merged(value: Any) -> dict[str, Any] | None:
    """Return a whole scenario with a part of one: of its file, of a vehicle, or its sensors."""
    if isinstance(value, list) and all(isinstance(entry, dict) for entry in value):
        value = {"sensors": value}
    if not isinstance(value, dict) or not value:
        return None
    if value.keys() <= fields("Scenario").keys():
        whole = SCENARIO | value
    elif value.keys() <= fields("Vehicle").keys():
        whole = SCENARIO | {"vehicles": [value]}
    else:
        return None
    if isinstance(whole["world"], dict):
        whole["world"] = {"name": "shown", "room": {"size_m": [12, 8, 3]}} | whole["world"]
    vehicles = [SCENARIO["vehicles"][0] | vehicle for vehicle in whole["vehicles"]]
    for vehicle in vehicles:
        vehicle["sensors"] = [
            {"name": f"sensor_{i}", "topic": f"/sensor_{i}", "frame": f"sensor_{i}"} | sensor
            for i, sensor in enumerate(vehicle["sensors"])
        ]
    return whole | {"vehicles": vehicles}


def part_of(value: Any) -> str | None:
    """Return the type of which a mapping has some fields."""
    if not isinstance(value, dict) or not value:
        return None
    for name in FILES:
        known = fields(name)
        is_kind = (
            "kind" not in value or name not in SHEETS or _accepts(known["kind"], value["kind"])
        )
        if value.keys() <= known.keys() and is_kind:
            return name
    return None


def _accepts(schema: dict[str, Any], value: Any) -> bool:
    validator = jsonschema.Draft202012Validator({**schema, "$defs": DEFINITIONS})
    found: bool = validator.is_valid(value)
    return found


def file_of(block: Block) -> str | None:
    """Return the file to which the text before a block has it written."""
    lines = block.page.read_text(encoding="utf-8").splitlines()
    before = "\n".join(lines[max(0, block.line - 8) : block.line - 1]) + "\n"
    written = _WRITTEN.search(before)
    return written[1] if written else None


SNIPPETS = {
    page: found
    for page in PAGES
    if page.parent != DOCS / "tutorials"  # They are followed in `test_tutorials`.
    and (
        found := [
            (block, value)
            for block in blocks(page)
            if block.language in ("yaml", "indented") and (value := value_of(block)) is not None
        ]
    )
}


@pytest.mark.parametrize("page", SNIPPETS, ids=lambda page: str(page.relative_to(ROOT)))
def test_snippets_are_valid(page: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Later blocks of a page may name files that earlier ones are written to."""
    for block, value in SNIPPETS[page]:
        if (file := file_of(block)) is not None:
            (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / file).write_text(block.text, encoding="utf-8")
        if (whole := merged(value)) is not None:
            if whole["world"] in WRITTEN_BY_COMMANDS:
                whole["world"] = SCENARIO["world"]
            (tmp_path / "shown.yaml").write_text(yaml.safe_dump(whole), encoding="utf-8")
            code = main(["check", str(tmp_path / "shown.yaml")])
            assert code == 0, f"{block}: {capsys.readouterr().err}"
            continue
        name = part_of(value)
        assert name is not None
        for field, part in value.items():
            schema = {**fields(name)[field], "$defs": DEFINITIONS}
            errors = jsonschema.Draft202012Validator(schema).iter_errors(part)
            assert [f"{block}: {field}: {error.message}" for error in errors] == []


def test_snippets_are_found() -> None:
    assert sum(map(len, SNIPPETS.values())) > 20
