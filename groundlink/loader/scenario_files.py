# SPDX-License-Identifier: Apache-2.0
"""Scenario loader: resolves a scenario file and the files it names into a `Scenario`.

References are followed first, then the whole is checked against the schema, then across fields.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from groundlink.core.errors import did_you_mean
from groundlink.importing.file_errors import Warn, ignore_warning
from groundlink.loader.namespaces import into_namespaces
from groundlink.scenario.expectations import Expectation
from groundlink.scenario.route import FIGURES, Route
from groundlink.scenario.schema import Scenario, Vehicle
from groundlink.scenario.sensor_kinds import (
    OWN_DISTRIBUTION,
    distribution_of,
    sensor_kinds,
    sheet_folders,
)

from . import urdf
from .asset_import import import_assets
from .checks import check_expectations, check_scenario, check_speeds
from .document import DataPath, Document, ScenarioError, read
from .material_library import define_soils, with_library_materials
from .overrides import Change
from .scatter import place_scatter
from .terrain_placement import place_outdoors, place_solids
from .validation_errors import convert

SHEETS = "sensors"
"""Folder of data sheets: beside a scenario's file, or in what is shipped."""

SHIPPED = (Path(__file__).parents[1] / "shipped").resolve()
"""Worlds, vehicles and data sheets that come with Groundlink: in a checkout a link to its folder
`scenarios`, in an installed package a copy of it."""


class _RouteFile(msgspec.Struct):
    """Schema of a route outside of a scenario; errors then name `route`."""

    route: Route


class _ExpectationsFile(msgspec.Struct):
    """Schema of a list of expectations, beside whatever else a file has."""

    expect: tuple[Expectation, ...]


def load(
    file: str | Path, *, changes: Iterable[Change] = (), warn: Warn = ignore_warning
) -> Scenario:
    """Return the scenario of `file` and the files it names.

    `file` may be the name of a shipped scenario; see `scenario_file`.

    `changes` change fields or sensors. `warn` receives warnings about heightmaps and meshes.

    Raises
    ------
    ScenarioError
        with one line: file, line, field, what was expected and how to mend it.
    """
    document = read(scenario_file(file))
    # A new data sheet has to be followed; a field of one is there only afterwards.
    late = [change for change in changes if not change.apply_where_written(document)]
    scenario = resolved(document, warn, late)
    check_scenario(scenario, document)
    return scenario


def scenario_file(given: str | Path) -> Path:
    """Return the file of a scenario: the given one, or the shipped one with this name.

    Raises
    ------
    ScenarioError
        when there is neither.
    """
    file = Path(given)
    if file.exists():
        return file
    if not file.suffix and (shipped := SHIPPED / f"{file}.yaml").is_file():
        return shipped
    names = [shipped.stem for shipped in SHIPPED.glob("*.yaml")]
    raise ScenarioError(
        f"{file}: no such file or directory; expected a file, or the name of a shipped scenario: "
        f"{did_you_mean(file.stem, names)}"
    )


def resolved(
    document: Document, warn: Warn = ignore_warning, changes: Iterable[Change] = ()
) -> Scenario:
    """Return the scenario of a document and the files it names, without the checks across fields.

    `changes` change the files, too.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    follow_references(document, warn)
    for change in changes:
        change.apply(document)
    import_assets(document, warn)
    place_scatter(document)
    place_outdoors(document)
    place_solids(document)
    into_namespaces(document)
    define_soils(document)
    return with_library_materials(convert(document, Scenario))


def read_route(given: str) -> Document:
    """Return the file of a route, unchecked.

    Raises
    ------
    ScenarioError
        when it can be neither a file nor a figure, or cannot be read.
    """
    if not given.endswith((".yaml", ".yml")):
        raise ScenarioError(
            f"no figure `{given}`; {did_you_mean(given, FIGURES)}, or pass a file whose "
            "name ends in .yaml"
        )
    return read(Path(given))


def load_route(given: str, vehicle: Vehicle) -> Route:
    """Return the route that a file describes, or the figure of this name with its defaults.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    if given in FIGURES:
        return FIGURES[given]()
    file = read_route(given)
    document = Document({"route": file.value}, {(): file.mark(())})
    document.put(("route",), file)
    route = convert(document, _RouteFile).route
    check_speeds(route, vehicle.model, document, ("route",))
    return route


def with_expectations(scenario: Scenario, given: str) -> Scenario:
    """Return a scenario with the expectations of another scenario's file, or of one with a list.

    Raises
    ------
    ScenarioError
        as `load` does; also if an expectation does not fit the scenario.
    """
    document = read(scenario_file(given))
    changed = replace(scenario, expect=convert(document, _ExpectationsFile).expect)
    check_expectations(changed, document)
    return changed


def follow_references(document: Document, warn: Warn = ignore_warning) -> None:
    """Replace every reference by its target.

    Raises
    ------
    ScenarioError
        when a file is missing or cannot be read.
    """
    _include(document, ("world",), "worlds")
    for v, vehicle in enumerate(_sequence(document.at(("vehicles",)))):
        here: DataPath = ("vehicles", v)
        urdf.refuse_bare_urdf(document, (*here, "model"))
        _include(document, (*here, "model"), "vehicles")
        urdf.expand(document, (*here, "model"), warn)
        _include(document, (*here, "route"), "routes")
        if not isinstance(vehicle, dict):
            continue
        for s, sensor in enumerate(_sequence(vehicle.get("sensors"))):
            follow_sensor(document, (*here, "sensors", s), sensor, vehicle.get("model"))
    _merge_materials(document)


def follow_sensor(document: Document, path: DataPath, sensor: Any, model: Any) -> None:
    """Replace a sensor's data sheet and the name of its mount by what they stand for.

    Raises
    ------
    ScenarioError
        when one of them does not exist.
    """
    _fill_from_datasheet(document, path, sensor)
    _place_on_mount(document, path, model)
    _name_package(sensor)


def _sequence(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _include(document: Document, path: DataPath, folder: str) -> None:
    """Replace a file's name by its content."""
    if isinstance(reference := document.at(path), str):
        document.put(path, read(_find(document, path, reference, folder)))


def _find(document: Document, path: DataPath, reference: str, folder: str) -> Path:
    """Return the file of a reference: beside the file that names it, or shipped."""
    mark = document.mark(path)
    try:
        return find_file(reference, folder, mark.file.parent)
    except ScenarioError as error:
        raise ScenarioError(f"{mark}: `{path[-1]}`: {error}") from None


def find_file(reference: str, folder: str, beside: Path) -> Path:
    """Return the file of a reference: in the folder `beside`, or shipped.

    Raises
    ------
    ScenarioError
        when there is none.
    """
    name = reference if reference.endswith((".yaml", ".yml")) else f"{folder}/{reference}.yaml"
    places = [beside / name, SHIPPED / name]
    if folder == SHEETS:
        places += [sheets / Path(name).name for sheets in sheet_folders()]
    for place in places:
        if place.is_file():
            return place
    if Path(name).is_absolute():
        raise ScenarioError(f"`{name}`: no such file")
    shipped = [file.stem for file in (SHIPPED / folder).glob("*.yaml")]
    if folder == SHEETS:
        shipped += [place.stem for sheets in sheet_folders() for place in sheets.glob("*.yaml")]
    hint = did_you_mean(Path(name).stem, shipped)
    raise ScenarioError(f"no file `{name}` in {beside.resolve()} or {SHIPPED}; {hint}")


def read_datasheet(file: Path) -> Document:
    """Return a data sheet, a mapping with a `kind`, unchecked.

    Raises
    ------
    ScenarioError
        when it is none.
    """
    sheet = read(file)
    if not isinstance(sheet.value, dict) or not isinstance(sheet.value.get("kind"), str):
        raise ScenarioError(f"{sheet.mark(())}: not a data sheet; expected a mapping with `kind`")
    return sheet


def _fill_from_datasheet(document: Document, path: DataPath, sensor: Any) -> None:
    """Fill the fields that a sensor does not state from its data sheet."""
    if not isinstance(sensor, dict) or not isinstance(sensor.get("datasheet"), str):
        return
    sheet_path = (*path, "datasheet")
    sheet = read_datasheet(_find(document, sheet_path, sensor["datasheet"], SHEETS))
    if sensor.get("kind", sheet.value["kind"]) != sheet.value["kind"]:
        raise ScenarioError(
            f"{document.mark(sheet_path)}: `datasheet`: {sensor['datasheet']} is of kind "
            f"`{sheet.value['kind']}`, but this sensor is of kind `{sensor['kind']}`"
        )
    sensor["datasheet"] = sheet.value.get("datasheet", sensor["datasheet"])
    for key, value in sheet.value.items():
        if key not in sensor:
            sensor[key] = None
            marks = {p[1:]: m for p, m in sheet.marks.items() if p[:1] == (key,)}
            document.put((*path, key), Document(value, marks))


def _name_package(sensor: Any) -> None:
    """State which distribution installs the kind of a sensor, where it is not Groundlink's own."""
    kind = sensor.get("kind") if isinstance(sensor, dict) else None
    if isinstance(kind, str) and kind in sensor_kinds():
        if (distribution := distribution_of(kind)) != OWN_DISTRIBUTION:
            sensor["package"] = distribution


def _place_on_mount(document: Document, path: DataPath, model: Any) -> None:
    """Replace the name of a mount by its pose in the vehicle's model."""
    mount = document.at((*path, "mount"))
    mounts = model.get("mounts", {}) if isinstance(model, dict) else {}
    if isinstance(mount, str) and model is None:  # The missing model is reported instead.
        del document.at(path)["mount"]
    elif isinstance(mount, str):
        if mount not in mounts:
            mark = document.mark((*path, "mount"))
            raise ScenarioError(
                f"{mark}: `mount`: unknown mount `{mount}`; {did_you_mean(mount, mounts)}"
            )
        document.at(path)["mount"] = mounts[mount]


def _merge_materials(document: Document) -> None:
    """Add the materials of all vehicles to those of the world, which take precedence.

    Two vehicles may share a name only for the same material.
    """
    world: DataPath = ("world", "materials")
    if isinstance(described := document.at(world[:1]), dict):
        described.setdefault("materials", {})
    listed, vehicles = document.at(world), document.at(("vehicles",))
    if not isinstance(listed, dict) or not isinstance(vehicles, list):
        return
    added: dict[str, DataPath] = {}
    for v in range(len(vehicles)):
        path: DataPath = ("vehicles", v, "model", "materials")
        own = document.at(path)
        for name, material in own.items() if isinstance(own, dict) else ():
            here = (*path, name)
            if name not in listed:
                marks = {p[len(here) :]: m for p, m in document.marks.items() if p[:5] == here}
                document.put((*world, name), Document(material, marks))
                added[name] = here
            elif name in added and document.at(added[name]) != material:
                raise ScenarioError(
                    f"{document.mark(here)}: another `{name}` is defined by the vehicle at "
                    f"{document.mark(added[name])}. Fix: rename one, or list `{name}` in the "
                    "world's materials, which overrides both"
                )
