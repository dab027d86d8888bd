# SPDX-License-Identifier: Apache-2.0
"""Import of the terrain and mesh files that a scenario names.

A description with `file`, or one of generated hills, is replaced by its resolved asset. Resolved
values stay as they are. Files are looked up beside the file that names them.
"""

from collections.abc import Iterator
from typing import Any

import msgspec

from groundlink.importing import meshes, terrain
from groundlink.importing.file_errors import BadFile, Warn
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.terrain_specs import TerrainSpec

from .document import DataPath, Document, ScenarioError
from .validation_errors import convert, dotted

TERRAIN: DataPath = ("world", "terrain")


class _Terrain(msgspec.Struct):
    """Wrapper, so that errors name `terrain`."""

    terrain: TerrainSpec


class _Shape(msgspec.Struct):
    shape: MeshFile


def import_assets(document: Document, warn: Warn) -> None:
    """Import all terrain and mesh files of a document; `warn` receives warnings.

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
