# SPDX-License-Identifier: Apache-2.0
"""`groundlink world import FILE`: make a world from a heightmap, mesh, scan or map.

`groundlink world show WHAT`: draw an image of a world, a vehicle or a scenario.
`groundlink world map WHAT`: write the true occupancy map of a world or a scenario.
"""

import argparse
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from groundlink.cli import Subparsers
from groundlink.cli.terminal.progress import progress
from groundlink.core.atomic_file import check_new_file, write_atomically
from groundlink.core.errors import UserError
from groundlink.importing import heightmaps, map_files, mesh_files, world_files
from groundlink.importing.mesh_specs import MeshFile
from groundlink.importing.terrain import BadTerrain
from groundlink.importing.terrain_specs import HeightmapFile
from groundlink.loader.asset_import import read_map
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.scene.build import solids
from groundlink.scene.true_map import default_heights_m, true_map

S = TypeVar("S", MeshFile, HeightmapFile)

MAX_PIXELS = 4096
"""Maximum width and height of an image."""

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")

MAP_SUFFIX = ".yaml"
"""Of maps of map_server."""

_FORMATS = (*heightmaps.FORMATS, *mesh_files.FORMATS, MAP_SUFFIX)

_FIELDS = ("heights_m", "cell_m", "size_m", "scale", "up")
"""Fields of file descriptions that are options here."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "world", help="make a world from a file, draw an image of a world, or write its map"
    )
    more = parser.add_subparsers(required=True, metavar="import|show|map")
    _add_import(more)
    shown = more.add_parser("show", help="draw an image of a world, a vehicle or a scenario")
    add_show_arguments(shown)
    shown.set_defaults(command=show)
    _add_map(more)


def add_show_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `show`, which the drawing process shares."""
    parser.add_argument(
        "what", metavar="WORLD|VEHICLE|SCENARIO", help="file (YAML), or name of a shipped one"
    )
    parser.add_argument(
        *("--out",),
        type=_picture,
        metavar="FILE.png|FILE.jpg",
        help="image to write (default: WHAT.png)",
    )
    parser.add_argument(
        *("--from",),
        type=_direction,
        dest="point",
        metavar="AZIMUTH,ELEVATION",
        help="viewpoint: degrees clockwise from north, and elevation in degrees",
    )
    parser.add_argument(
        *("--size",),
        type=_size,
        default=(960, 640),
        metavar="WIDTHxHEIGHT",
        help="image size in pixels (default: 960x640)",
    )


def show(options: argparse.Namespace) -> int:
    """Start the process that draws the image."""
    words = [options.what, "--size", "{}x{}".format(*options.size)]
    words += ["--out", str(options.out)] if options.out else []
    words += ["--from={:g},{:g}".format(*options.point)] if options.point else []
    module = "services.sensors.rendering.portrait"
    with progress(f"drawing {options.what}"):
        done = subprocess.run(
            [sys.executable, "-m", module, *words], capture_output=True, text=True, check=False
        )
    print(done.stderr, end="", file=sys.stderr)
    print(done.stdout, end="")
    return done.returncode


def is_picture(file: Path) -> bool:
    """Return whether a file name has the suffix of an image."""
    return file.suffix.lower() in IMAGE_SUFFIXES


def _picture(text: str) -> Path:
    if not is_picture(Path(text)):
        raise argparse.ArgumentTypeError(
            f"`{text}`: expected a file name that ends in {', '.join(IMAGE_SUFFIXES)}"
        )
    return Path(text)


def _direction(text: str) -> tuple[float, float]:
    azimuth, _, elevation = text.partition(",")
    try:
        found = float(azimuth), float(elevation)
    except ValueError:
        found = (math.nan, math.nan)
    if not (abs(found[0]) <= 360 and 0 <= found[1] <= 90):
        raise argparse.ArgumentTypeError(f"`{text}`: expected AZIMUTH,ELEVATION such as 200,35")
    return found


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= min(int(width), int(height))):
        raise argparse.ArgumentTypeError(f"`{text}`: expected WIDTHxHEIGHT such as 960x640")
    if max(int(width), int(height)) > MAX_PIXELS:
        raise argparse.ArgumentTypeError(
            f"`{text}`: expected at most {MAX_PIXELS} pixels for width and height"
        )
    return int(width), int(height)


def _add_import(subparsers: Subparsers) -> None:
    parser = subparsers.add_parser(
        "import", help="make a world from a heightmap, mesh, scan or map, and print its content"
    )
    parser.add_argument("file", type=Path, help=f"one of {', '.join(_FORMATS)}")
    parser.add_argument("--out", type=Path, metavar="WORLD.yaml", help="world file to write")
    of_map = parser.add_argument_group("heightmaps")
    of_map.add_argument(
        "--heights-m",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="heights of black and white in a PNG",
    )
    of_map.add_argument("--cell-m", type=float, metavar="M", help="side length of a cell")
    of_map.add_argument(
        "--size-m", type=float, nargs=2, metavar=("X", "Y"), help="alternative: lengths of the map"
    )
    of_mesh = parser.add_argument_group("meshes and scans")
    of_mesh.add_argument("--scale", type=float, metavar="S", help="meters in a unit of the file")
    of_mesh.add_argument("--up", choices=("y", "z"), help="axis of the file that points up")
    parser.set_defaults(command=import_)


def import_(options: argparse.Namespace) -> int:
    """Print the content of a file; write a world file with `--out`."""
    file, out = options.file, options.out
    folder = Path() if out is None else out.parent
    if out is not None:
        check_new_file("--out", out)
    if file.suffix.lower() not in _FORMATS:
        raise UserError(f"{file}: unknown format; expected one of {', '.join(_FORMATS)}")
    named = os.path.relpath(file, folder)
    print(f"{file}:", flush=True)
    with progress(f"reading {file}"):
        text = _world_text(options, named)
    if out is not None:
        with write_atomically(out) as part:
            part.write_text(text, encoding="utf-8")
        _say(f"wrote {out}; use it in a scenario of the same folder: `world: {out.name}`")
    return 0


def _world_text(options: argparse.Namespace, named: str) -> str:
    """Return the world file of a heightmap or mesh, which it calls `named`."""
    file = options.file
    if file.suffix.lower() == MAP_SUFFIX:
        _given_fields(options, ())
        described, found = read_map(file)
        return world_files.of_map(found, described.occupied_thresh, named, _say)
    if file.suffix.lower() in mesh_files.FORMATS:
        mesh = _spec(options, MeshFile, ("scale", "up"))
        return world_files.of_mesh(mesh, named, _say, _warn)
    heightmap = _spec(
        options, HeightmapFile, ("heights_m", "cell_m", "size_m"), material=world_files.MATERIAL
    )
    try:
        return world_files.of_heightmap(heightmap, named, _say, _warn)
    except BadTerrain as error:
        raise UserError(f"{file}: {_option(error.field)}: {error.problem}") from None


def _spec(options: argparse.Namespace, spec: type[S], fields: tuple[str, ...], **fixed: Any) -> S:
    """Return the description from the options; raise UserError for options of another format."""
    given = _given_fields(options, fields)
    kind = spec.__struct_config__.tag
    try:
        return msgspec.convert({"kind": kind, "file": str(options.file)} | given | fixed, spec)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        field = where.strip("`").partition("[")[0]
        raise UserError(f"{_option(field)}: {problem[:1].lower()}{problem[1:]}") from None


def _given_fields(options: argparse.Namespace, fields: tuple[str, ...]) -> dict[str, Any]:
    """Return the given fields of a file; raise UserError for options of another format."""
    given = {name: getattr(options, name) for name in _FIELDS if getattr(options, name) is not None}
    if wrong := given.keys() - set(fields):
        raise UserError(
            f"{_option(min(wrong))}: does not apply to {options.file}. Fix: leave it out"
        )
    return given


def _add_map(subparsers: Subparsers) -> None:
    parser = subparsers.add_parser(
        "map", help="write the true occupancy map of a world or a scenario, for map_server"
    )
    parser.add_argument(
        "what", metavar="WORLD|SCENARIO", help="file (YAML), or name of a shipped one"
    )
    parser.add_argument(
        *("--out",),
        type=Path,
        required=True,
        metavar="MAP.yaml",
        help="map to write, with a picture MAP.pgm beside it",
    )
    parser.add_argument(
        "--resolution-m",
        type=float,
        default=0.05,
        metavar="M",
        help="edge of a cell (default: 0.05)",
    )
    parser.add_argument(
        "--heights-m",
        type=float,
        nargs=2,
        metavar=("LOW", "HIGH"),
        help="heights of obstacles above the ground (default: that of the first planar scanner, or "
        "0.1 1.0 without one)",
    )
    parser.add_argument(
        "--like", type=Path, metavar="MAP.yaml", help="take the cells of another map"
    )
    parser.set_defaults(command=write_map)


def write_map(options: argparse.Namespace) -> int:
    """Write the map of a world.

    Raises
    ------
    UserError
        when there is no world, its map is too large, or a file exists.
    """
    out: Path = options.out
    if out.suffix != MAP_SUFFIX:
        raise UserError(f"--out {out}: expected a file name that ends in {MAP_SUFFIX}")
    for file in (out, out.with_suffix(".pgm")):
        check_new_file("--out", file)
    if not (math.isfinite(options.resolution_m) and options.resolution_m > 0):
        raise UserError(f"--resolution-m {options.resolution_m}: expected meters above 0")
    if options.heights_m and not options.heights_m[0] <= options.heights_m[1]:
        raise UserError("--heights-m: expected the lower height first")
    with progress(f"reading {options.what}"):
        kind, scenario = load_partial(options.what, warn=_warn)
        if kind is FileKind.VEHICLE:
            raise UserError(f"{options.what}: a vehicle; expected a world or a scenario")
        low_m, high_m = options.heights_m or default_heights_m(scenario)
        found = true_map(
            scenario,
            solids(scenario),
            resolution_m=options.resolution_m,
            heights_m=(low_m, high_m),
            grid=read_map(options.like)[1].grid if options.like else None,
        )
    grid = found.grid
    picture = map_files.write(found, out)
    print(f"{options.what}:")
    _say(f"{grid.columns} x {grid.rows} cells of {grid.resolution_m:g} m")
    _say(f"obstacles from {low_m:g} to {high_m:g} m above the ground")
    _say(world_files.counts(found))
    _say(f"wrote {out} and {picture}")
    return 0


def _option(field: str) -> str:
    return f"--{field.replace('_', '-')}"


def _say(line: str) -> None:
    print(f"  {line}", flush=True)


def _warn(line: str) -> None:
    print(f"groundlink: warning: {line}", file=sys.stderr)
