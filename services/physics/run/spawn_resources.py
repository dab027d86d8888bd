# SPDX-License-Identifier: Apache-2.0
"""Resources of world queries: what tools spawn by name, file or text, and which worlds there are.

Files are those of the host of physics.
"""

import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlparse

from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode.world_queries import QueryRefused, SpawnableReport, WorldReport
from groundlink.loader.additions import KINDS, content_of
from groundlink.loader.document import ScenarioError, read
from groundlink.loader.scenario_files import SHIPPED, find_file
from groundlink.scenario.additions import Addition
from groundlink.scenario.schema import Category
from groundlink.scene.entities import Corners, box_around, vehicle_solids
from groundlink.world.actors import form_solids

SUFFIXES = (".yaml", ".yml")

DESCRIPTIONS = {
    "box": "Cardboard box of 0.5 m that stands still",
    "barrel": "Steel drum of 0.88 m that stands still",
    "person": "Person who stands still",
    "crate": "Cardboard crate of 10 kg that can be pushed",
}
"""Descriptions of the named objects."""

CATEGORIES: dict[str, Category] = {"person": "human"}
"""Categories of named objects that stand still, where they are not static objects."""


class SpawnResource(NamedTuple):
    """What a tool wants to spawn."""

    name: str
    content: Addition
    category: Category
    """Category of its static solids."""


def resource(uri: str, text: str) -> SpawnResource:
    """Return the resource of a name, path or `file://` URI, or of a file's text without a URI.

    Raises
    ------
    QueryRefused
        when it cannot be read or is nothing that can be spawned.
    """
    if not uri and not text:
        raise QueryRefused("no_resource", "nothing to spawn. Fix: pass a URI, or a file's text")
    if not uri:
        return _of_text(text)
    if uri in KINDS:
        return SpawnResource(uri, KINDS[uri], CATEGORIES.get(uri, "static_object"))
    if uri in _vehicles():
        return _read(uri, uri)
    path = _path(uri)
    if path is None or (not path.suffix and not path.exists()):
        known = [*KINDS, *_vehicles()]
        raise QueryRefused("not_found", f"no resource `{uri}`; {did_you_mean(uri, known)}")
    if path.suffix not in SUFFIXES:
        raise _unsupported(path.name)
    if not path.is_file():
        raise QueryRefused("not_found", f"{path}: no such file. Fix: copy it to physics' host")
    return _read(str(path), str(path))


def _of_text(text: str) -> SpawnResource:
    if text.lstrip().startswith("<"):
        raise _unsupported("XML text")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "text.yaml")
        file.write_text(text, encoding="utf-8")
        return _read(str(file), "text")


def _read(given: str, where: str) -> SpawnResource:
    try:
        name, content = content_of(given)
    except UserError as problem:
        line = str(problem).replace(given, where)
        raise QueryRefused(
            "missing_assets" if "no such file" in line else "parse_error", line
        ) from None
    return SpawnResource(name, content, "static_object")


def _unsupported(what: str) -> QueryRefused:
    return QueryRefused(
        "unsupported_format",
        f"{what}: unsupported format; expected a vehicle or a world as YAML. Fix: for a URDF, "
        "write a vehicle file that names it, with `urdf`, `wheels` and `drive`",
    )


def _path(uri: str) -> Path | None:
    """Return the path of a file URI or a path; None for a URI of something else."""
    parts = urlparse(uri)
    if parts.scheme == "file":
        return Path(unquote(parts.path))
    return None if parts.scheme else Path(uri)


@cache
def _vehicles() -> tuple[str, ...]:
    return tuple(sorted(file.stem for file in (SHIPPED / "vehicles").glob("*.yaml")))


def spawnables(sources: Iterable[str]) -> tuple[list[SpawnableReport], list[str]]:
    """Return what can be spawned by name or from further folders, and the unknown folders."""
    found = [*_shipped_spawnables()]
    files, unknown = _files(sources)
    for file in files:
        try:
            found.append(_spawnable(str(file), f"{file.name}"))
        except QueryRefused:  # a scenario, or another YAML file
            continue
    return found, unknown


@cache
def _shipped_spawnables() -> tuple[SpawnableReport, ...]:
    objects = [_spawnable(name, DESCRIPTIONS[name]) for name in KINDS]
    return (*objects, *(_spawnable(name, f"Vehicle `{name}`") for name in _vehicles()))


def _spawnable(uri: str, description: str) -> SpawnableReport:
    low, high = _box(resource(uri, "").content)
    return SpawnableReport(uri, description, low, high)


def _box(content: Addition) -> Corners:
    parts = [*content.solids]
    for actor in content.actors:
        parts += form_solids(actor.form)
    for vehicle in content.vehicles:
        parts += vehicle_solids(vehicle.model)
    return box_around(parts)


def worlds(sources: Iterable[str]) -> tuple[list[WorldReport], list[str]]:
    """Return the shipped scenarios and worlds and those in further folders, and unknown folders."""
    found = [
        _world(file, file.relative_to(SHIPPED).with_suffix("").as_posix())
        for folder in (SHIPPED, SHIPPED / "worlds")
        for file in sorted(folder.glob("*.yaml"))
    ]
    files, unknown = _files(sources)
    for file in files:
        try:
            found.append(_world(file, str(file)))
        except ScenarioError:
            continue
    return found, unknown


def _world(file: Path, uri: str) -> WorldReport:
    """Return what a file says of itself and of the world that it names."""
    document = read(file)
    world = document.at(("world",))
    if isinstance(world, str):
        with suppress(ScenarioError):
            world = read(find_file(world, "worlds", file.parent)).value
    described = world if isinstance(world, dict) else {}
    tags = document.at(("tags",)) or described.get("tags")
    return WorldReport(
        name=str(document.at(("name",)) or file.stem),
        uri=uri,
        description=str(document.at(("description",)) or described.get("description", "")),
        tags=tuple(map(str, tags)) if isinstance(tags, list) else (),
    )


def _files(sources: Iterable[str]) -> tuple[Sequence[Path], list[str]]:
    """Return the YAML files of folders, and those sources that are no folders here."""
    files: list[Path] = []
    unknown = []
    for source in sources:
        folder = _path(source)
        if folder is None or not folder.is_dir():
            unknown.append(source)
        else:
            files += _yaml_files(folder)
    return files, unknown


def _yaml_files(folder: Path) -> Iterator[Path]:
    yield from sorted(file for file in folder.iterdir() if file.suffix in SUFFIXES)
