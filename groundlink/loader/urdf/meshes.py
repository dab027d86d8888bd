# SPDX-License-Identifier: Apache-2.0
"""Mesh files that a URDF names.

The axes of a mesh are those of the link, whatever the format says about up, as in RViz.
`package://` is looked up around the URDF first, then where ROS is installed, so a copied folder
works. Files of a mesh may lie anywhere in the package, such as `materials/textures`.
"""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from groundlink.importing.file_errors import BadFile, Warn
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.meshes import import_mesh
from groundlink.world.solids import Mesh

from .elements import XmlElement

Scale = tuple[float, ...]


class UrdfMeshes:
    """Loader of a URDF's meshes with a cache.

    `warn` receives warnings about their files.
    """

    def __init__(self, warn: Warn) -> None:
        self._warn = warn
        self._made: dict[tuple[Path, Scale], Mesh] = {}

    def get(self, element: XmlElement) -> Mesh:
        """Return the mesh of a `<mesh>` element.

        Raises
        ------
        ScenarioError
            when the file is missing or unusable.
        """
        folder, name = _file(element)
        file = folder / name
        scale = element.numbers("scale", 3, (1.0, 1.0, 1.0))
        if 0 in scale:
            raise element.mistake(f'scale="{element.text("scale")}" makes it flat')
        if (file, scale) not in self._made:
            try:
                made = import_mesh(MeshFile(file=name, up="z"), folder, self._warn)
            except BadFile as error:
                raise element.mistake(str(error)) from None
            # A mirroring scale inverts the winding of faces.
            faces = made.faces if np.prod(scale) > 0 else made.faces[:, ::-1]
            scaled = (made.vertices * scale).astype(np.float32)
            self._made[file, scale] = replace(made, vertices=scaled, faces=faces).shape()
        return self._made[file, scale]


def _file(element: XmlElement) -> tuple[Path, str]:
    """Return the folder of a mesh and the name of its file in it."""
    name = element.text("filename")
    scheme, has_scheme, rest = name.partition("://")
    urdf = element.mark.file
    if not has_scheme:
        candidates = [(urdf.parent, name)]
    elif scheme == "file":
        candidates = [(Path(rest).parent, Path(rest).name)]
    elif scheme in ("package", "model"):
        package, _, path = rest.partition("/")
        candidates = [(folder, path) for folder in _packages(urdf.resolve(), package)]
    else:
        raise element.mistake(f"`{name}`: expected a file's name, package:// or file://")
    for folder, inside in candidates:
        if (file := folder / inside).is_file():
            if file.suffix.lower() == ".dae":
                raise element.mistake(
                    f"{file}: Collada is not read; convert it to GLB or OBJ, as Blender does"
                )
            return folder, inside
    if scheme in ("package", "model") and has_scheme:
        raise element.mistake(
            f"no `{path}` in a folder `{package}` around {urdf.parent} or in AMENT_PREFIX_PATH; "
            "copy the package there"
        )
    raise element.mistake(f"there is no file `{Path(*candidates[0])}`; correct its name")


def _packages(urdf: Path, name: str) -> Iterator[Path]:
    """Yield candidate folders of a package, the nearest first."""
    for folder in urdf.parents:
        if folder.name == name:
            yield folder
        yield folder / name
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        yield Path(prefix, "share", name)
