# SPDX-License-Identifier: Apache-2.0
"""Cost of importing and reading large worlds: `python -m benchmarks.worlds`.

Each figure is of a new process, after its imports: processor time, and growth of the peak resident
memory. The files are generated and removed.
"""

import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from groundlink.importing import meshes, terrain
from groundlink.importing.file_errors import ignore_warning
from groundlink.importing.hills import heights
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.terrain_specs import HeightmapFile, HillsTerrain
from groundlink.world.assets import VARIABLE
from groundlink.world.terrain import Terrain, load_ground

SIZE_M = 15_000.0


def hills(cell_m: float) -> HillsTerrain:
    """Return generated hills, 15 km square."""
    return HillsTerrain(
        size_m=(SIZE_M, SIZE_M), cell_m=cell_m, height_m=120.0, longest_m=3000.0, material="grass"
    )


def make_maps(folder: Path) -> list[str]:
    """Write 1501 x 1501 heights in every format; return the files' names."""
    made = heights(hills(10.0))
    north_first = np.ascontiguousarray(made[::-1])
    Image.fromarray(np.rint(north_first / 120 * 65535).astype(np.uint16)).save(folder / "map.png")
    Image.fromarray(north_first).save(folder / "map.tif", compression="tiff_adobe_deflate")
    np.save(folder / "map.npy", made)
    with (folder / "map.asc").open("w") as file:
        file.write(f"ncols {made.shape[1]}\nnrows {made.shape[0]}\ncellsize 10\n")
        np.savetxt(file, north_first, fmt="%.2f")
    return ["map.png", "map.tif", "map.npy", "map.asc"]


def make_meshes(folder: Path, side: int = 708) -> list[str]:
    """Write a wavy sheet of a million triangles and a scan of two million points."""
    x, y = np.meshgrid(np.linspace(-50, 50, side), np.linspace(-50, 50, side))
    vertices = np.stack([x, y, np.sin(x / 3) + np.cos(y / 4)], axis=-1).reshape(-1, 3)
    number = np.arange(side * side).reshape(side, side)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([d, c, b], -1)], axis=2).reshape(-1, 3)
    sheet = trimesh.Trimesh(vertices, faces, process=False)
    for name in ("mesh.ply", "mesh.obj", "mesh.stl", "mesh.glb"):
        sheet.export(folder / name)
    points = np.random.default_rng(0).uniform(-50, 50, (2_000_000, 3))
    points[:, 2] = np.sin(points[:, 0] / 3)
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    header += "property float x\nproperty float y\nproperty float z\nend_header\n"
    (folder / "scan.ply").write_bytes(header.encode() + points.astype("<f4").tobytes())
    return ["mesh.ply", "mesh.obj", "mesh.stl", "mesh.glb", "scan.ply"]


def import_map(folder: Path, name: str) -> Terrain:
    """Import a heightmap."""
    heights_m = (0.0, 120.0) if name.endswith("png") else None
    spec = HeightmapFile(file=name, material="grass", cell_m=10.0, heights_m=heights_m)
    return terrain.build(spec, folder, ignore_warning)


def import_mesh(folder: Path, name: str) -> None:
    """Import a mesh or scan."""
    meshes.import_mesh(MeshFile(file=name), folder, ignore_warning).shape()


def cost(work: Callable[[], object]) -> tuple[float, float]:
    """Return the processor's seconds and the megabytes that a piece of work takes."""
    before = _most_resident_mb()
    began = time.process_time()
    work()
    seconds = time.process_time() - began
    return seconds, _most_resident_mb() - before


def _most_resident_mb() -> float:
    """Return the most that was resident; `getrusage` would tell that of the parent."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) / 1024


def main() -> None:
    """Measure and print a table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ[VARIABLE] = str(folder / "assets")
        jobs: dict[str, Callable[[], object]] = {}
        for file in make_maps(folder):
            jobs[f"import {file}, 1501 x 1501"] = partial(import_map, folder, file)
        for file in make_meshes(folder):
            jobs[f"import {file}"] = partial(import_mesh, folder, file)
        for cell_m in (10.0, 5.0, 2.5):
            spec = hills(cell_m)
            built = terrain.build(spec, folder, ignore_warning)
            jobs[f"make hills of 15 km at {cell_m:g} m"] = partial(
                terrain.build, spec, folder, ignore_warning
            )
            jobs[f"read terrain of 15 km at {cell_m:g} m"] = partial(load_ground, built)
        for what, work in jobs.items():
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                seconds, megabytes = pool.apply(cost, (work,))
            print(f"{what:42} {seconds:6.2f} s {megabytes:7.0f} MB")


if __name__ == "__main__":
    main()
