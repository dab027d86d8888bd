# SPDX-License-Identifier: Apache-2.0
"""Resources of world queries: what tools spawn or load by name, file or text, and which there are.

Files are those of the host of physics.
"""

import re
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlparse

from msgspec.structs import replace

from groundlink.core.errors import UserError, did_you_mean
from groundlink.episode.world_queries import QueryRefused, SpawnableReport, WorldReport
from groundlink.loader.additions import KINDS, content_of
from groundlink.loader.document import ScenarioError, read
from groundlink.loader.partial_scenario import FileKind, load_partial
from groundlink.loader.scenario_files import SHIPPED, find_file
from groundlink.scenario import Scenario
from groundlink.scenario.additions import Addition
from groundlink.scenario.schema import NAMESPACE
from groundlink.scene.entities import Corners, box_around, vehicle_solids
from groundlink.world.actors import Category, form_solids

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
    path = str(_file(uri, (*KINDS, *_vehicles())))
    return _read(path, path)


def _of_text(text: str) -> SpawnResource:
    with _text_file(text) as file:
        return _read(file, "text")


@contextmanager
def _text_file(text: str) -> Iterator[str]:
    """Yield a file with this content, whose format is that of Groundlink."""
    if text.lstrip().startswith("<"):
        raise _unsupported("XML text")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "text.yaml")
        file.write_text(text, encoding="utf-8")
        yield str(file)


def _file(uri: str, known: Iterable[str]) -> Path:
    """Return the YAML file of a path or file URI; `known` are names that would do, too."""
    path = _path(uri)
    if path is None or (not path.suffix and not path.exists()):
        raise QueryRefused("not_found", f"no resource `{uri}`; {did_you_mean(uri, known)}")
    if path.suffix not in SUFFIXES:
        raise _unsupported(path.name)
    if not path.is_file():
        raise QueryRefused("not_found", f"{path}: no such file. Fix: copy it to physics' host")
    return path


def _read(given: str, where: str) -> SpawnResource:
    with _refusals(given, where):
        name, content = content_of(given)
    return SpawnResource(name, content, "static_object")


@contextmanager
def _refusals(given: str, where: str) -> Iterator[None]:
    """Refuse a file with a mistake; errors have `where` in place of its path."""
    try:
        yield
    except UserError as problem:
        line = str(problem).replace(given, where)
        if where != given:
            line = line.replace(f"{Path(given).parent}/", "")
        raise QueryRefused(
            "missing_assets" if "no such file" in line else "parse_error", line
        ) from None


def _unsupported(what: str) -> QueryRefused:
    return QueryRefused(
        "unsupported_format",
        f"{what}: unsupported format; expected a vehicle or a world as YAML. Fix: for a URDF, "
        "write a vehicle file that names it, with `urdf`, `wheels` and `drive`; for a mesh, a "
        "heightmap or a map, `groundlink world import`",
    )


def in_namespace(more: Addition, namespace: str) -> Addition:
    """Return an addition whose vehicles have their topics in a namespace."""
    full = f"/{namespace.strip('/')}"
    if not re.fullmatch(NAMESPACE, full):
        raise QueryRefused(
            "namespace_invalid",
            f"`{namespace}` cannot be a namespace; expected letters, digits and underscores "
            "between slashes",
        )
    vehicles = tuple(
        replace(vehicle, namespace=full, command_topic=f"{full}/cmd_vel")
        for vehicle in more.vehicles
    )
    return replace(more, vehicles=vehicles)


def loadable_world(uri: str, text: str) -> Scenario:
    """Return the world of a name, path or `file://` URI, or of a file's text without a URI.

    Returns
    -------
    A checked scenario, or one without vehicles if the file describes a world alone.

    Raises
    ------
    QueryRefused
        when it cannot be read or is no world.
    """
    if not uri and not text:
        raise QueryRefused("no_resource", "no world to load. Fix: pass a URI, or a file's text")
    if not uri:
        with _text_file(text) as file:
            return _read_world(file, "text")
    shipped = _shipped_worlds()
    named = {file.stem: file for file in shipped.values()} | shipped
    path = str(named.get(uri) or _file(uri, named))
    return _read_world(path, path)


def _read_world(given: str, where: str) -> Scenario:
    with _refusals(given, where):
        kind, found = load_partial(given)
    if kind is FileKind.VEHICLE:
        raise QueryRefused("parse_error", f"{where}: a vehicle; expected a scenario or a world")
    return found


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
    found = [_world(file, uri) for uri, file in _shipped_worlds().items()]
    files, unknown = _files(sources)
    for file in files:
        try:
            found.append(_world(file, str(file)))
        except ScenarioError:
            continue
    return found, unknown


@cache
def _shipped_worlds() -> dict[str, Path]:
    """Return the files of the shipped scenarios and worlds by their names."""
    files = [
        file for folder in ("", "worlds") for file in sorted((SHIPPED / folder).glob("*.yaml"))
    ]
    return {file.relative_to(SHIPPED).with_suffix("").as_posix(): file for file in files}


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
