# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of scenario, world, vehicle, route and data sheet files, for editors.

Generated from the types that check a resolved scenario, plus the shorter forms that files allow:
names of other files and mounts, data sheets, terrain and mesh files. An editor finds most mistakes
with them; `load` finds all. The docstrings of the fields become their descriptions.
"""

import inspect
import json
import typing
from collections.abc import Iterable, Iterator
from typing import Any, TypeAlias

import msgspec
from msgspec.inspect import Field, StructType, Type, multi_type_info

from groundlink.core.field_docs import field_descriptions, summary
from groundlink.importing.map_specs import OccupancyMapFile
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.terrain_specs import TerrainSpec
from groundlink.scenario.route import Route
from groundlink.scenario.schema import Scenario, Sensor, Vehicle, World
from groundlink.scenario.vehicle import VehicleModel
from groundlink.world.solids import Material, Mesh
from groundlink.world.terrain import Terrain

from .scatter import Scatter
from .terrain_placement import ON_GROUND

Schema: TypeAlias = dict[str, Any]

DIALECT = "https://json-schema.org/draft/2020-12/schema"

_AT_ITS_PLACE = frozenset({"name", "topic", "frame", "mount"})
"""Fields of a sensor that only a scenario states."""

TOPIC_IN_FILES = r"^[A-Za-z0-9_/]+$"
"""Pattern of topics in files, where the namespace is optional."""

_TOPICS = (r"^/[A-Za-z0-9_/]+$", TOPIC_IN_FILES)
"""Patterns of topics in a resolved scenario, and in files."""

_BY_NAME = ((Scenario, "world"), (Vehicle, "model"), (Vehicle, "route"), (Material, "soil"))
"""Fields whose value may be the name of a file, or of a soil of the library."""

RESOLVED = (Terrain, Mesh)
"""Types that the loader makes of the first of `_IN_FILES`; people do not write them."""

_IN_FILES = (TerrainSpec, MeshFile, Scatter, OccupancyMapFile)
"""Types that only files have: the loader replaces them."""

_ALL_TYPES = (Scenario, *_IN_FILES)


def json_schema(kind: str) -> Schema:
    """Return the schema of one of `KINDS` of files, in the 2020-12 dialect."""
    definitions = _definitions()
    return {
        "$schema": DIALECT,
        "title": f"Groundlink {kind}",
        **_any_of(definitions, KINDS[kind]),
        "$defs": definitions | _sheets(definitions),
    }


def _definitions() -> dict[str, Schema]:
    """Return the definitions of all types in scenario files, by name."""
    made = json.dumps(msgspec.json.schema(Scenario)["$defs"])
    definitions: dict[str, Schema] = json.loads(
        made.replace(json.dumps(_TOPICS[0]), json.dumps(_TOPICS[1]))
    )
    for owner, field in _BY_NAME:
        _also(definitions[owner.__name__]["properties"], field, {"type": "string"})
    described, components = msgspec.json.schema_components(_IN_FILES, ref_template="#/$defs/{name}")
    for resolved, description in zip(RESOLVED, described[:2], strict=True):
        _also(definitions, resolved.__name__, description)
    definitions |= components
    definitions["Solid"]["properties"][ON_GROUND] = {
        "type": "boolean",
        "description": "Whether `position_m` counts from the terrain below the solid.",
    }
    definitions["World"]["properties"]["scatter"] = {
        "type": "array",
        "items": described[2],
        "description": "Objects placed at random over the terrain; they become `outdoors`.",
    }
    definitions["World"]["properties"]["map"] = described[3] | {
        "description": "Occupancy map of which walls and a floor are made; they become `solids`."
    }
    _also(definitions, "VehicleModel", _of_urdf(definitions))
    for sensor in _names(Sensor):
        properties = definitions[sensor]["properties"]
        if "mount" in properties:
            _also(properties, "mount", {"type": "string"})
        definitions[sensor] = _with_datasheet(definitions[sensor])
    structs = {struct.cls.__name__: struct for struct in _structs(multi_type_info(_ALL_TYPES))}
    _describe(definitions, {name: _descriptions(struct) for name, struct in structs.items()})
    return definitions


def _structs(part: object) -> Iterator[StructType]:
    """Yield the structs in types, with repetitions."""
    match part:
        case tuple() | list():
            for member in part:
                yield from _structs(member)
        case Type() | Field():
            if isinstance(part, StructType):
                yield part
            for name in part.__struct_fields__:
                yield from _structs(getattr(part, name))


def _descriptions(struct: StructType) -> dict[str, str]:
    """Return the description of each field of a struct, and of its tag."""
    texts = field_descriptions(struct.cls)
    if struct.tag_field is not None:
        texts[struct.tag_field] = f"`{struct.tag}`: {summary(struct.cls.__doc__ or '')}"
    return texts


def _describe(part: Any, texts: dict[str, dict[str, str]]) -> None:
    """Add the descriptions to the properties of all structs in a part of a schema, by title.

    Those of the structs themselves lose the indentation that Python 3.12 and older keep.
    """
    if isinstance(part, list):
        for member in part:
            _describe(member, texts)
    elif isinstance(part, dict):
        if isinstance(own := part.get("description"), str):
            part["description"] = inspect.cleandoc(own)
        for field, text in texts.get(part.get("title", ""), {}).items():
            part["properties"].get(field, {}).setdefault("description", text)
        for member in part.values():
            _describe(member, texts)


def _also(properties: Schema, field: str, form: Schema) -> None:
    """Add an alternative form to a field."""
    known = properties[field]
    properties[field] = {"anyOf": [form, known]}


def _of_urdf(definitions: dict[str, Schema]) -> Schema:
    """Return the form of a vehicle with a URDF and overriding fields."""
    model, some_wheel, some_chassis = (
        {key: value for key, value in definitions[name].items() if key != "required"}
        for name in ("VehicleModel", "Wheel", "Chassis")
    )
    joints = {
        "type": "object",
        "additionalProperties": {"anyOf": [{"type": "null"}, some_wheel]},
        "description": "Joints that carry wheels, each with the fields that override the URDF.",
    }
    urdf = {
        "type": "string",
        "description": "Path of a URDF, relative to the file that names it. Its links and joints "
        "become the model. Other fields override it.",
    }
    own = {"urdf": urdf, "wheels": joints, "chassis": some_chassis}
    return model | {
        "properties": model["properties"] | own,
        "required": ["urdf", "wheels", "drive"],
    }


def _with_datasheet(sensor: Schema) -> Schema:
    """Return the form of a sensor with all required fields, or with a data sheet."""
    needed = sensor["required"]
    own = [field for field in needed if field in _AT_ITS_PLACE]
    return sensor | {
        "required": own,
        "anyOf": [{"required": ["datasheet"]}, {"required": needed}],
    }


def _sheets(definitions: dict[str, Schema]) -> dict[str, Schema]:
    """Return the definitions of data sheets, named after the sensor with the suffix `Sheet`."""
    return {
        f"{sensor}Sheet": {
            key: value
            for key, value in definitions[sensor].items()
            if key not in ("required", "anyOf")
        }
        | {"required": ["kind"]}
        for sensor in _names(Sensor)
    }


def _names(union: Any) -> list[str]:
    """Return the names of a type's members, or its own."""
    members: Iterable[Any] = typing.get_args(union) or (union,)
    return [member.__name__ for member in members]


def _any_of(definitions: dict[str, Schema], names: list[str]) -> Schema:
    references = [{"$ref": f"#/$defs/{name}"} for name in names]
    return references[0] if len(references) == 1 else {"anyOf": references}


KINDS: dict[str, list[str]] = {
    "scenario": _names(Scenario),
    "world": _names(World),
    "vehicle": _names(VehicleModel),
    "route": _names(Route),
    "datasheet": [f"{sensor}Sheet" for sensor in _names(Sensor)],
}
"""Definitions for each kind of file."""
