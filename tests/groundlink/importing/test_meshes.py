# SPDX-License-Identifier: Apache-2.0
"""Meshes of every format: in meters, z up, painted as in their files; scans as discs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from groundlink.importing import meshes, pcd
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.meshes import ImportedMesh
from groundlink.importing.scans import CORNERS
from groundlink.world.mesh_asset import load_mesh

from .files import COLORS, MESHES, cloud, glb, gltf, lzf, pcd as pcd_file, png, write  # isort: skip


def made(folder: Path, name: str, content: bytes, **given: Any) -> tuple[ImportedMesh, list[str]]:
    write(folder, name, content)
    told: list[str] = []
    return meshes.import_mesh(MeshFile(file=name, **given), folder, told.append), told


@pytest.mark.parametrize("name", ["box.obj", "box.ply", "box.stl", "ascii.stl"])
def test_every_format_is_the_same_box(tmp_path: Path, name: str) -> None:
    box, told = made(tmp_path, name, MESHES[name])
    corners = np.unique(box.vertices.round(6), axis=0)
    expected = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-1, 1) for z in (-1.5, 1.5)])
    assert corners == pytest.approx(expected)
    assert len(box.faces) == 12
    assert [(part.count, part.color, part.picture) for part in box.parts] == [(12, None, None)]
    assert not told
    shape = box.shape()
    assert (shape.low_m, shape.high_m) == ((-0.5, -1.0, -1.5), (0.5, 1.0, 1.5))
    assert (load_mesh(shape.asset).vertices == box.vertices).all()


def test_a_scene_of_parts_is_one_surface_with_z_up(tmp_path: Path) -> None:
    box, told = made(tmp_path, "box.glb", glb())
    assert not told
    assert box.vertices.min(axis=0) == pytest.approx([-0.5, -1.5, -1.0])
    assert box.vertices.max(axis=0) == pytest.approx([5.5, 1.5, 1.0])
    painted = {part.picture is not None: part for part in box.parts}
    assert painted[False].color is None
    assert painted[True].color == pytest.approx((1.0, 128 / 255, 0.0), abs=1e-6)
    assert painted[True].picture == painted[True].normals == png(COLORS)
    own = box.faces[painted[True].first : painted[True].first + painted[True].count]
    assert box.vertices[own][..., 0].max() == pytest.approx(0.5)
    assert box.uv is not None
    assert np.ptp(box.uv[own].reshape(-1, 2), axis=0).min() > 0.5


@pytest.mark.parametrize(("up", "size"), [("y", (1, 3, 2)), ("z", (1, 2, 3)), (None, (1, 2, 3))])
def test_up_and_scale_follow_the_spec(
    tmp_path: Path, up: Any, size: tuple[float, float, float]
) -> None:
    box, _ = made(tmp_path, "box.ply", MESHES["box.ply"], up=up, scale=0.5)
    assert np.ptp(box.vertices, axis=0) == pytest.approx(np.array(size) / 2)


def test_gltf_is_turned_about_x(tmp_path: Path) -> None:
    found, _ = made(tmp_path, "t.gltf", gltf())
    assert found.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 0, 1]]
    found, _ = made(tmp_path, "t.gltf", gltf(nodes=[{"mesh": 0, "translation": [0, 0, 5]}]))
    assert found.vertices[0].tolist() == [0, -5, 0]


def test_a_mirrored_part_keeps_its_outside(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    box, _ = made(tmp_path, "box.glb", scene.export(file_type="glb"))
    a, b, c = np.moveaxis(box.vertices[box.faces].astype(np.float64), 1, 0)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(1.0)


@pytest.mark.parametrize(
    "nodes",
    [
        [*({"mesh": 0, "children": [i + 1]} for i in range(2000)), {"mesh": 0}],
        [{"mesh": 0, "children": [1]}, {"mesh": 0, "children": [0]}],
        [{"mesh": 0, "children": [0]}],
    ],
)
def test_chains_and_rings_of_parts_take_no_time(tmp_path: Path, nodes: list[Any]) -> None:
    found, _ = made(tmp_path, "chain.gltf", gltf(nodes=nodes))
    assert len(found.faces) >= len(nodes)


def test_colors_of_vertices_become_a_picture(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(2)
    ball.visual.vertex_colors = np.where(ball.vertices[:, 2:] > 0, [255, 0, 0], [0, 0, 255])
    found, _ = made(tmp_path, "ball.ply", ball.export(file_type="ply"))
    (part,) = found.parts
    assert part.picture is not None
    assert found.uv is not None
    pixels = np.asarray(Image.open(write(tmp_path, "p.png", part.picture)))
    height, width = pixels.shape[:2]
    at = found.uv[found.faces]
    assert (at == at[:, :1]).all()
    column, row = (at[:, 0, 0] * width).astype(int), ((1 - at[:, 0, 1]) * height).astype(int)
    heights = found.vertices[found.faces][..., 2]
    assert (pixels[row, column][(heights > 0.01).all(axis=1)] == (255, 0, 0)).all()
    assert (pixels[row, column][(heights < -0.01).all(axis=1)] == (0, 0, 255)).all()


def test_obj_has_its_texture_and_reports_a_missing_one(tmp_path: Path) -> None:
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\n"
    text += "f 1/1 2/2 3/3\n"
    write(tmp_path, "m.mtl", b"newmtl a\nKd 0.5 0.5 0.5\nmap_Kd p.png\n")
    write(tmp_path, "p.png", png(COLORS))
    found, told = made(tmp_path, "t.obj", text.encode())
    assert found.parts[0].picture == png(COLORS)
    assert not told
    (tmp_path / "p.png").unlink()
    found, told = made(tmp_path, "t.obj", text.encode())
    assert found.parts[0].picture is None
    assert found.parts[0].color == pytest.approx((0.2140,) * 3, abs=0.01)
    assert len(told) == 1
    assert "`p.png` is missing" in told[0]
    write(tmp_path, "p.png", png(COLORS)[:-30])
    found, told = made(tmp_path, "t.obj", text.encode())
    assert found.parts[0].picture is None
    assert len(told) == 1
    assert "cannot be read" in told[0]


OUTSIDE = "lies outside its folder; its content is ignored"


@pytest.mark.parametrize(
    ("place", "name", "problem"),
    [
        ("world/meshes/skins", "skins/p.png", None),
        ("world/skins", "../skins/p.png", None),
        ("world/meshes", "/home/painter/p.png", None),
        (".", "../../p.png", OUTSIDE),
        (".", "{place}/p.png", OUTSIDE),
        (".", "link.png", OUTSIDE),
    ],
)
@pytest.mark.parametrize("kind", ["obj", "gltf"])
def test_files_outside_the_folders_of_a_mesh_and_its_world_are_left_out(
    tmp_path: Path, kind: str, place: str, name: str, problem: str | None
) -> None:
    """`place` is where the picture lies, the mesh in `world/meshes`, the world in `world`."""
    for folder in (tmp_path / "world/meshes", tmp_path / place):
        folder.mkdir(parents=True, exist_ok=True)
    picture = write(tmp_path / place, "p.png", png(COLORS))
    (tmp_path / "world/meshes/link.png").symlink_to(picture)
    name = name.format(place=tmp_path / place)
    write(tmp_path / "world/meshes", "m.mtl", f"newmtl a\nmap_Kd {name}\n".encode())
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\n"
    attributes = {"POSITION": 0, "TEXCOORD_0": 0}
    content = {
        "obj": f"{text}f 1/1 2/2 3/3\n".encode(),
        "gltf": gltf(
            meshes=[{"primitives": [{"attributes": attributes, "indices": 1, "material": 0}]}],
            materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
            textures=[{"source": 0}],
            images=[{"uri": name}],
        ),
    }[kind]
    found, told = made(tmp_path / "world", f"meshes/t.{kind}", content)
    if problem is None:
        assert found.parts[0].picture == png(COLORS)
        assert not told
    else:
        assert found.parts[0].picture is None
        assert [line.partition(": ")[2] for line in told] == [f"its `{name}` {problem}"]


@pytest.mark.parametrize(
    "linked", [(), ("t.obj",), ("t.obj", "m.mtl"), ("m.mtl", "t.obj", "p.png")]
)
def test_a_mesh_of_another_folder_may_be_a_link_with_its_files(
    tmp_path: Path, linked: tuple[str, ...]
) -> None:
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\n"
    content = {
        "t.obj": f"{text}f 1/1 2/2 3/3\n".encode(),
        "m.mtl": b"newmtl a\nmap_Kd p.png\n",
        "p.png": png(COLORS),
    }
    for folder in ("world", "meshes", "source"):
        (tmp_path / folder).mkdir()
    for name in content:
        write(tmp_path / ("source" if name in linked else "meshes"), name, content[name])
        if name in linked:
            (tmp_path / "meshes" / name).symlink_to(tmp_path / "source" / name)
    told: list[str] = []
    found = meshes.import_mesh(MeshFile(file="../meshes/t.obj"), tmp_path / "world", told.append)
    assert found.parts[0].picture == png(COLORS)
    assert not told


def test_an_obj_takes_no_materials_from_outside(tmp_path: Path) -> None:
    (tmp_path / "world").mkdir()
    write(tmp_path, "m.mtl", b"newmtl a\nKd 1 0 0\n")
    text = "mtllib ../m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n"
    found, told = made(tmp_path / "world", "t.obj", text.encode())
    assert found.parts[0].color is None
    assert [line.partition(": ")[2] for line in told] == [f"its `../m.mtl` {OUTSIDE}"]


@pytest.mark.parametrize(
    ("size", "problem"), [(2000.0, "Fix: for millimeters, `scale: 0.001`"), (1e-3, "small")]
)
def test_suspicious_sizes_are_warned_about(tmp_path: Path, size: float, problem: str) -> None:
    box = trimesh.creation.box((size, size, size)).export(file_type="stl")
    _, told = made(tmp_path, "box.stl", box)
    assert len(told) == 1
    assert problem in told[0]


@pytest.mark.parametrize("name", ["cloud.ply", "cloud.pcd", "ascii.pcd", "packed.pcd"])
def test_points_become_discs_in_their_surface(tmp_path: Path, name: str) -> None:
    scan, _ = made(tmp_path, name, MESHES[name])
    assert scan.points == 400
    corners = scan.vertices[scan.faces].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal = across / np.linalg.norm(across, axis=1, keepdims=True)
    assert np.abs(normal @ (0, np.sqrt(0.5), -np.sqrt(0.5))).min() > 0.999
    # The plane is covered: by four times its area at most, and with few holes.
    assert 16 * 0.8 < np.linalg.norm(across, axis=1).sum() / 2 < 16 * 4
    discs = scan.vertices.reshape(-1, CORNERS, 3).mean(axis=1)
    probes = np.random.default_rng(0).uniform(-1.8, 1.8, (500, 2))
    probes = np.stack([probes[:, 0], *2 * [probes[:, 1] * np.sqrt(0.5)]], axis=-1)
    radius = np.linalg.norm(scan.vertices[0] - discs[0])
    near = np.linalg.norm(probes[:, None] - discs[None], axis=-1).min(axis=1)
    assert (near < radius).mean() > 0.8


def test_a_scan_of_too_many_points_is_thinned_and_keeps_its_colors(tmp_path: Path) -> None:
    points = np.random.default_rng(0).uniform(-2, 2, (5000, 3)) * (1, 1, 0)
    colors = np.where(points[:, :1] > 0, [255, 0, 0], [0, 255, 0])
    content = trimesh.PointCloud(points, colors=colors).export(file_type="ply")
    scan, told = made(tmp_path, "scan.ply", content, most_points=300)
    assert len(scan.faces) <= 300 * (CORNERS - 2)
    assert len(scan.faces) > 100 * (CORNERS - 2)
    assert "5000 points were thinned" in told[0]
    assert scan.parts[0].picture is not None


def test_places_where_a_scanner_saw_nothing_are_left_out(tmp_path: Path) -> None:
    points = cloud()
    points[::4] = np.nan
    content = trimesh.PointCloud(points).export(file_type="ply")
    scan, told = made(tmp_path, "scan.ply", content)
    assert scan.points == 300
    assert "100 of 400 points are not numbers" in told[0]


def test_pcd_has_points_and_colors_in_all_its_forms(tmp_path: Path) -> None:
    for form in ("binary", "ascii", "binary_compressed"):
        points, colors = pcd.read(write(tmp_path, "c.pcd", pcd_file(form)))
        assert points == pytest.approx(cloud(), abs=1e-6)
        assert colors is not None
        assert colors[0] == pytest.approx((1.0, 128 / 255, 0.0))


def test_lzf_refers_back_into_what_it_is_writing() -> None:
    data = b"abc" + bytes(300) + b"x" * 10 + b"end"
    packed = lzf(data)
    size = np.array([len(packed), len(data)], "<u4").tobytes()
    assert pcd._decompressed(size + packed) == data
    # Three bytes as they are, then three from the very first one on.
    assert pcd._decompressed(b"\6\0\0\0\6\0\0\0" + b"\2abc" + bytes([1 << 5, 2])) == b"abcabc"
