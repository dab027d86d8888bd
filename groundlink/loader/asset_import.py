# SPDX-License-Identifier: Apache-2.0
"""Import of the terrain, map and mesh files that a scenario names.

A description with `file`, or one of generated hills, is replaced by its resolved asset; a map
becomes solids. Resolved values stay as they are. Files are looked up beside the file that names
them.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec

from groundlink.importing import map_files, meshes, terrain
from groundlink.importing.file_errors import BadFile, Warn
from groundlink.importing.map_specs import MapServerYaml, OccupancyMapFile
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.terrain_specs import TerrainSpec
from groundlink.world.occupancy import OccupancyMap

from .document import DataPath, Document, ScenarioError, SourceLine, read
from .validation_errors import convert, dotted

WORLD: DataPath = ("world",)
TERRAIN: DataPath = ("world", "terrain")
MAP: DataPath = ("world", "map")
SOLIDS: DataPath = ("world", "solids")


class _Terrain(msgspec.Struct):
    """Wrapper, so that errors name `terrain`."""

    terrain: TerrainSpec


class _Map(msgspec.Struct):
    map: OccupancyMapFile


class _Shape(msgspec.Struct):
    shape: MeshFile


def import_assets(document: Document, warn: Warn) -> None:
    """Import all terrain, map and mesh files of a document; `warn` receives warnings.

    Raises
    ------
    ScenarioError
        when a description or a file is wrong.
    """
    described = document.at(TERRAIN)
    if isinstance(described, dict) and "heights" not in described:
        ground = convert(document.alone(TERRAIN), _Terrain).terrain
        folder = document.mark(TERRAIN).file.parent
        try:
            built = terrain.build(ground, folder, warn)
        except terrain.BadTerrain as error:
            mark = document.mark((*TERRAIN, error.field))
            raise ScenarioError(f"{mark}: `terrain`: {error}") from None
        except BadFile as error:
            raise ScenarioError(f"{document.mark(TERRAIN)}: `terrain`: {error}") from None
        document.put(TERRAIN, Document(msgspec.to_builtins(built)))
    if isinstance(world := document.at(WORLD), dict) and "map" in world:
        _import_map(document, world)
    known: dict[tuple[str, MeshFile], Any] = {}
    for path in list(_mesh_files(document.value, ())):
        mesh = convert(document.alone(path), _Shape).shape
        mark = document.mark((*path, "file"))
        key = str(mark.file.parent), mesh
        if key not in known:
            try:
                known[key] = msgspec.to_builtins(
                    meshes.import_mesh(mesh, mark.file.parent, warn).shape()
                )
            except BadFile as error:
                raise ScenarioError(f"{mark}: `{dotted(path)}`: {error}") from None
        document.put(path, Document(known[key]))


def _import_map(document: Document, world: dict[str, Any]) -> None:
    """Replace the map of a world by solids, which come before those of the file."""
    spec = convert(document.alone(MAP), _Map).map
    mark = document.mark((*MAP, "file"))
    if world.get("terrain") is not None:
        raise ScenarioError(
            f"{document.mark(MAP)}: `map`: the world has `terrain`, too. Fix: keep one of them"
        )
    file = mark.file.parent / spec.file
    described, found = read_map(file)
    try:
        built = map_files.solids_of(found, spec, described.occupied_thresh)
    except BadFile as error:
        raise ScenarioError(f"{mark}: `map`: {file}: {error}") from None
    own = world.get("solids", [])
    if not isinstance(own, list):
        return  # the schema reports it
    marks: dict[DataPath, SourceLine] = {(number,): mark for number in range(len(built))}
    for path in [path for path in document.marks if path[:2] == SOLIDS]:
        line = document.marks.pop(path)
        if len(path) > 2 and isinstance(number := path[2], int):
            marks[(len(built) + number, *path[3:])] = line
    document.put(SOLIDS, Document([*msgspec.to_builtins(built), *own], marks))
    del world["map"]


def read_map(file: Path) -> tuple[MapServerYaml, OccupancyMap]:
    """Return the content of a YAML file of map_server, and the map it describes.

    Raises
    ------
    ScenarioError
        when the file or its picture cannot be used.
    """
    document = read(file)
    described = convert(document, MapServerYaml)
    try:
        return described, map_files.read_map(described, file.parent)
    except BadFile as error:
        raise ScenarioError(f"{document.mark(('image',))}: `image`: {error}") from None


def _mesh_files(value: Any, path: DataPath) -> Iterator[DataPath]:
    """Yield the paths of mesh files in plain data."""
    if isinstance(value, dict):
        if value.get("kind") == "mesh" and "asset" not in value:
            yield path
        for key, part in value.items():
            yield from _mesh_files(part, (*path, key))
    elif isinstance(value, list):
        for index, part in enumerate(value):
            yield from _mesh_files(part, (*path, index))
