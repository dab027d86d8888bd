# SPDX-License-Identifier: Apache-2.0
"""From a scenario file to a resolved `Scenario`, or to one line that says what is wrong.

Rule: references to other files are followed first, then the whole is checked at once against the
schema, then what types cannot say. Nothing starts before all of it holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from groundlink.importing.files import Tell, silent
from groundlink.world.build import WorldError, solids
from groundlink.world.starts import check_starts

from . import urdf
from .brought import bring_materials
from .document import DataPath, Document, ScenarioError, read
from .explain import convert, dotted, nearest
from .fast_fit import window_mistake
from .fault_fit import mistake
from .grounded import place_outdoors, place_solids
from .imported import bring_assets
from .namespaces import into_namespaces
from .ros_side import TOLD_BY_THE_GATEWAY
from .route import FIGURES, Route, ThereAndBack, Waypoints
from .scattered import sow
from .schema import RESERVED_NAMES, RESERVED_SENSOR_NAMES, Scenario, Vehicle
from .sensors import Encoders, Gnss, Sensor, WheelOdometry
from .vehicle import VehicleModel

SHIPPED = (Path(__file__).parents[1] / "shipped").resolve()
"""Worlds, vehicles and data sheets that come with Groundlink: in a checkout a link to its folder
`scenarios`, in an installed package a copy of it."""


class _RouteFile(msgspec.Struct):
    """What a route is read as that is no scenario's, so that errors name `route`."""

    route: Route


def load(file: str | Path, *, tell: Tell = silent) -> Scenario:
    """Return the scenario that `file` and the files it names describe.

    `file` may be the name of a shipped scenario; see `scenario_file`.

    `tell` takes what is doubtful about the heightmaps and meshes among them.

    Raises
    ------
    ScenarioError
        with one line: file, line, field, what was expected and how to mend it.
    """
    document = read(scenario_file(file))
    scenario = resolved(document, tell)
    _check(scenario, document)
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
        f"{nearest(file.stem, names)}"
    )


def resolved(document: Document, tell: Tell = silent) -> Scenario:
    """Return the scenario that a document and the files it names describe; not all is checked.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    _follow_references(document, tell)
    bring_assets(document, tell)
    sow(document)
    place_outdoors(document)
    place_solids(document)
    into_namespaces(document)
    return convert(document, Scenario)


def load_route(given: str, vehicle: Vehicle) -> Route:
    """Return the route that a file describes, or the figure of this name with its defaults.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    if not given.endswith((".yaml", ".yml")):
        if given not in FIGURES:
            raise ScenarioError(
                f"no figure `{given}`; {nearest(given, FIGURES)}, or a file with a `.yaml` name"
            )
        return FIGURES[given]()
    file = read(Path(given))
    document = Document({"route": file.value}, {(): file.mark(())})
    document.put(("route",), file)
    route = convert(document, _RouteFile).route
    _check_speeds(route, vehicle.model, document, ("route",))
    return route


def _follow_references(document: Document, tell: Tell) -> None:
    """Put in the place of every reference what it refers to."""
    _include(document, ("world",), "worlds")
    for v, vehicle in enumerate(_sequence(document.at(("vehicles",)))):
        here: DataPath = ("vehicles", v)
        urdf.must_not_be_alone(document, (*here, "model"))
        _include(document, (*here, "model"), "vehicles")
        urdf.expand(document, (*here, "model"), tell)
        _include(document, (*here, "route"), "routes")
        if not isinstance(vehicle, dict):
            continue
        for s, sensor in enumerate(_sequence(vehicle.get("sensors"))):
            _fill_from_datasheet(document, (*here, "sensors", s), sensor)
            _place_on_mount(document, (*here, "sensors", s), vehicle.get("model"))
    bring_materials(document)


def _sequence(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _include(document: Document, path: DataPath, folder: str) -> None:
    """Replace a file's name by its content."""
    if isinstance(reference := document.at(path), str):
        document.put(path, read(_find(document, path, reference, folder)))


def _find(document: Document, path: DataPath, reference: str, folder: str) -> Path:
    """Return the file that a reference names: beside the file that names it, or shipped."""
    mark = document.mark(path)
    try:
        return find(reference, folder, mark.file.parent)
    except ScenarioError as error:
        raise ScenarioError(f"{mark}: `{path[-1]}`: {error}") from None


def find(reference: str, folder: str, beside: Path) -> Path:
    """Return the file that a reference names: in a folder `beside`, or shipped.

    Raises
    ------
    ScenarioError
        when there is none.
    """
    name = reference if reference.endswith((".yaml", ".yml")) else f"{folder}/{reference}.yaml"
    for base in (beside, SHIPPED):
        if (base / name).is_file():
            return base / name
    if Path(name).is_absolute():
        raise ScenarioError(f"there is no file `{name}`")
    shipped = [file.stem for file in (SHIPPED / folder).glob("*.yaml")]
    raise ScenarioError(
        f"no file `{name}` in {beside.resolve()} or {SHIPPED}; {nearest(Path(name).stem, shipped)}"
    )


def read_datasheet(file: Path) -> Document:
    """Return a data sheet, a mapping with a `kind`, unchecked.

    Raises
    ------
    ScenarioError
        when it is none.
    """
    sheet = read(file)
    if not isinstance(sheet.value, dict) or not isinstance(sheet.value.get("kind"), str):
        raise ScenarioError(f"{sheet.mark(())}: a data sheet is a mapping with a `kind`")
    return sheet


def _fill_from_datasheet(document: Document, path: DataPath, sensor: Any) -> None:
    """Give a sensor the fields of its data sheet that it does not state itself."""
    if not isinstance(sensor, dict) or not isinstance(sensor.get("datasheet"), str):
        return
    sheet_path = (*path, "datasheet")
    sheet = read_datasheet(_find(document, sheet_path, sensor["datasheet"], "sensors"))
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


def _place_on_mount(document: Document, path: DataPath, model: Any) -> None:
    """Replace the name of a mount by the pose that the vehicle's model gives it."""
    mount = document.at((*path, "mount"))
    mounts = model.get("mounts", {}) if isinstance(model, dict) else {}
    if isinstance(mount, str) and model is None:  # That it is missing is what is to be told.
        del document.at(path)["mount"]
    elif isinstance(mount, str):
        if mount not in mounts:
            mark = document.mark((*path, "mount"))
            raise ScenarioError(f"{mark}: `mount`: no mount `{mount}`; {nearest(mount, mounts)}")
        document.at(path)["mount"] = mounts[mount]


def _check(scenario: Scenario, document: Document) -> None:
    """Check what types cannot say: names that must differ or must exist."""
    if not scenario.vehicles:
        raise ScenarioError(f"{document.mark(('vehicles',))}: `vehicles`: expected at least one")
    _unique(document, ("vehicles",), [v.name for v in scenario.vehicles])
    for v, vehicle in enumerate(scenario.vehicles):
        here: DataPath = ("vehicles", v)
        _free(document, (*here, "name"), vehicle.name, RESERVED_NAMES)
        taken: list[str] = []
        for section, specs in (("sensors", vehicle.sensors), ("streams", vehicle.streams)):
            for s, spec in enumerate(specs):
                _free(document, (*here, section, s, "name"), spec.name, RESERVED_SENSOR_NAMES)
            _unique(document, (*here, section), [spec.name for spec in specs], taken)
            taken += [spec.name for spec in specs]
        for s, sensor in enumerate(vehicle.sensors):
            if isinstance(sensor, Gnss) and scenario.world.datum is None:
                raise ScenarioError(
                    f"{document.mark((*here, 'sensors', s))}: `{sensor.name}` receives satellites, "
                    f"but `world.datum` is missing: add `datum: {{latitude_deg: ..., "
                    f"longitude_deg: ..., altitude_m: ...}}` of the world's origin"
                )
            _check_wheels(sensor, vehicle, document, (*here, "sensors", s))
            _check_faults(sensor, vehicle, document, (*here, "sensors", s, "faults"))
        if vehicle.route is not None:
            _check_speeds(vehicle.route, vehicle.model, document, (*here, "route"))
    time = scenario.time
    every_sensor = (sensor for vehicle in scenario.vehicles for sensor in vehicle.sensors)
    if time.mode != "realtime" and (found := window_mistake(time, every_sensor)):
        mark = document.mark(("time", "window_ticks"))
        raise ScenarioError(f"{mark}: `time.window_ticks`: {found}")
    topics = [t for v in scenario.vehicles for s in v.sensors for t in s.ros_topics().values()]
    topics += [s.topic for v in scenario.vehicles for s in v.streams]
    topics += [scenario.ground_truth_topic(v) for v in scenario.vehicles]
    topics += [scenario.true_wheels_topic(v) for v in scenario.vehicles]
    topics.append(scenario.bodies.topic)
    if twice := [topic for topic in topics if topics.count(topic) > 1]:
        raise ScenarioError(
            f"{document.mark(())}: two streams share the topic `{twice[0]}`; give each its own"
        )
    topics += TOLD_BY_THE_GATEWAY
    heard = [topic for v in scenario.vehicles for topic in v.from_ros.all_topics()]
    heard += [v.command_topic for v in scenario.vehicles]
    if again := [t for t in heard if t in topics or heard.count(t) > 1]:
        raise ScenarioError(
            f"{document.mark(())}: `{again[0]}` is taken from ROS, but is another stream's topic, "
            "too; give each its own"
        )
    try:
        check_starts(scenario, solids(scenario))
    except WorldError as error:
        raise ScenarioError(f"{document.mark(error.path)}: {error}") from None


def _check_wheels(sensor: Sensor, vehicle: Vehicle, document: Document, path: DataPath) -> None:
    """Refuse encoders of wheels that there are not, and odometry of encoders that there are not."""
    if isinstance(sensor, Encoders):
        wheels = [shaft.name for shaft in vehicle.model.counted]
        for i, name in enumerate(sensor.reversed_wheels):
            if name not in wheels:
                mark = document.mark((*path, "reversed_wheels", i))
                raise ScenarioError(
                    f"{mark}: `reversed_wheels`: no wheel `{name}`; {nearest(name, wheels)}"
                )
    if isinstance(sensor, WheelOdometry):
        encoders = [s.name for s in vehicle.sensors if isinstance(s, Encoders)]
        if sensor.encoders not in encoders:
            mark = document.mark((*path, "encoders"))
            hint = nearest(sensor.encoders, encoders) if encoders else "add one"
            raise ScenarioError(
                f"{mark}: `encoders`: no sensor `{sensor.encoders}` of kind `encoders`; {hint}"
            )


def _check_faults(sensor: Sensor, vehicle: Vehicle, document: Document, path: DataPath) -> None:
    """Refuse faults that the sensor cannot have."""
    for i, fault in enumerate(sensor.faults):
        if found := mistake(fault, sensor, vehicle):
            where = (*path, i, found[0])
            raise ScenarioError(f"{document.mark(where)}: `{dotted(where)}`: {found[1]}")


def _check_speeds(route: Route, model: VehicleModel, document: Document, path: DataPath) -> None:
    """Refuse a route that asks for more than the vehicle can: in speed, or to turn on the spot."""
    if isinstance(route, ThereAndBack) and model.least_radius_m:
        raise ScenarioError(
            f"{document.mark(path)}: `{dotted(path)}`: `{model.name}` cannot turn on the spot; "
            "expected another kind than `there_and_back`"
        )
    most = model.top_speed_mps
    asked: list[tuple[DataPath, float | None]] = [((*path, "speed_mps"), route.speed_mps)]
    if isinstance(route, Waypoints):
        for i, point in enumerate(route.points):
            asked.append(((*path, "points", i, "speed_mps"), point.speed_mps))
    for where, speed in asked:
        if speed is not None and speed > most:
            raise ScenarioError(
                f"{document.mark(where)}: `{dotted(where)}`: {speed:g} m/s is more than the "
                f"{most:.2f} m/s that `{model.name}` can drive; ask for less"
            )


def _free(document: Document, path: DataPath, name: str, reserved: frozenset[str]) -> None:
    if name in reserved:
        mark = document.mark(path)
        raise ScenarioError(f"{mark}: `{name}` names a key of the bus; choose another name")


def _unique(
    document: Document, path: DataPath, names: list[str], taken: Sequence[str] = ()
) -> None:
    for i, name in enumerate(names):
        if name in names[:i] or name in taken:
            mark = document.mark((*path, i, "name"))
            raise ScenarioError(f"{mark}: the name `{name}` is taken; choose another")
