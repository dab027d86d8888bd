# SPDX-License-Identifier: Apache-2.0
"""Meshes that stand still, as the engine has them: triangle by triangle, hollow where they are.

Rule: all triangles of the mesh, in its own frame. They go to the engine through a file of the STL
kind: as arguments it takes 131,072 vertices at most, and files of the OBJ kind take it twice as
long to read.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from groundlink.core.errors import UserError
from groundlink.world.mesh_asset import surface
from groundlink.world.solids import Mesh, Solid

from .engine import Engine

MOST_TRIANGLES = 2_000_000
"""A million takes 4 s and 0.3 GB."""

SKIN_M = 0.001
"""How near to triangles the engine begins to look for contacts: at 0, what just rests on level ones
is let fall at times."""

HEAD_BYTES = 80

_FACE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])


class StaticMeshes:
    """Meshes in an engine, each kept once however often it stands there."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._shapes: dict[str, int] = {}

    def put(self, solid: Solid, mesh: Mesh) -> int:
        """Put a solid that is a mesh into the engine and return its body.

        Raises
        ------
        UserError
            when it has too many triangles.
        """
        if mesh.asset not in self._shapes:
            self._shapes[mesh.asset] = self._shape(solid.name, mesh)
        body: int = self._engine.createMultiBody(
            baseCollisionShapeIndex=self._shapes[mesh.asset],
            baseVisualShapeIndex=self._engine.unseen,
            basePosition=solid.position_m,
            baseOrientation=solid.orientation,
        )
        self._engine.changeDynamics(body, -1, collisionMargin=SKIN_M)
        return body

    def _shape(self, name: str, mesh: Mesh) -> int:
        found = surface(mesh.asset)
        if len(found.faces) > MOST_TRIANGLES:
            raise UserError(
                f"the mesh of `{name}` has {len(found.faces):,} triangles, more than physics can "
                f"bear; expected {MOST_TRIANGLES:,} at most: thin it out before it is imported"
            )
        faces = np.zeros(len(found.faces), _FACE)
        faces["corners"] = found.vertices[found.faces]
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder, "mesh.stl")
            file.write_bytes(bytes(HEAD_BYTES) + np.uint32(len(faces)).tobytes() + faces.tobytes())
            engine = self._engine
            shape: int = engine.createCollisionShape(
                engine.GEOM_MESH,
                fileName=str(file),
                # The latter, or edges push what rolls over them where they are level.
                flags=engine.GEOM_FORCE_CONCAVE_TRIMESH | engine.GEOM_CONCAVE_INTERNAL_EDGE,
            )
        return shape
