# SPDX-License-Identifier: Apache-2.0
"""From a scenario file to a resolved `Scenario`, or to one line that says what is wrong.

Rule: references to other files are followed first, then the whole is checked at once against the
schema, then what types cannot say. Nothing starts before all of it holds.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from groundlink.clock import TICK_RATE_HZ
from groundlink.world.build import WorldError, solids

from .document import DataPath, Document, ScenarioError, read
from .fields import field_names, kinds
from .route import FIGURES, Route, Waypoints
from .schema import RESERVED_NAMES, RESERVED_SENSOR_NAMES, Scenario, Vehicle
from .sensors import Encoders, Gnss, Sensor, WheelOdometry
from .vehicle import VehicleModel

SHIPPED = Path(__file__).resolve().parents[2] / "scenarios"
"""Worlds, vehicles and data sheets that come with Groundlink."""

S = TypeVar("S", bound=msgspec.Struct)


class _RouteFile(msgspec.Struct):
    """What a route is read as that is no scenario's, so that errors name `route`."""

    route: Route


def load(file: str | Path) -> Scenario:
    """Return the scenario that `file` and the files it names describe.

    Raises
    ------
    ScenarioError
        with one line: file, line, field, what was expected and how to mend it.
    """
    document = read(Path(file))
    _follow_references(document)
    scenario = _convert(document, Scenario)
    _check(scenario, document)
    return scenario


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
    route = _convert(document, _RouteFile).route
    _check_speeds(route, vehicle.model, document, ("route",))
    return route


def nearest(word: str, known: Iterable[str]) -> str:
    """Return a hint that names the known word closest to `word`, or all of them."""
    known = sorted(known)
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
    return f"did you mean `{close[0]}`?" if close else f"expected one of {', '.join(known)}"


def _follow_references(document: Document) -> None:
    """Put in the place of every reference what it refers to."""
    _include(document, ("world",), "worlds")
    for v, vehicle in enumerate(_sequence(document.at(("vehicles",)))):
        here: DataPath = ("vehicles", v)
        _include(document, (*here, "model"), "vehicles")
        _include(document, (*here, "route"), "routes")
        if not isinstance(vehicle, dict):
            continue
        for s, sensor in enumerate(_sequence(vehicle.get("sensors"))):
            _fill_from_datasheet(document, (*here, "sensors", s), sensor)
            _place_on_mount(document, (*here, "sensors", s), vehicle.get("model"))


def _sequence(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []


def _include(document: Document, path: DataPath, folder: str) -> None:
    """Replace a file's name by its content."""
    if isinstance(reference := document.at(path), str):
        document.put(path, read(_find(document, path, reference, folder)))


def _find(document: Document, path: DataPath, reference: str, folder: str) -> Path:
    """Return the file that a reference names: beside the file that names it, or shipped."""
    mark = document.mark(path)
    name = reference if reference.endswith((".yaml", ".yml")) else f"{folder}/{reference}.yaml"
    for base in (mark.file.parent, SHIPPED):
        if (base / name).is_file():
            return base / name
    shipped = [f"{folder}/{file.name}" for file in (SHIPPED / folder).glob("*.yaml")]
    raise ScenarioError(
        f"{mark}: `{path[-1]}`: no file `{name}` beside this file or in {SHIPPED}; "
        f"{nearest(name, shipped)}"
    )


def _fill_from_datasheet(document: Document, path: DataPath, sensor: Any) -> None:
    """Give a sensor the fields of its data sheet that it does not state itself."""
    if not isinstance(sensor, dict) or not isinstance(sensor.get("datasheet"), str):
        return
    sheet_path = (*path, "datasheet")
    sheet = read(_find(document, sheet_path, sensor["datasheet"], "sensors"))
    if not isinstance(sheet.value, dict) or not isinstance(sheet.value.get("kind"), str):
        raise ScenarioError(f"{sheet.mark(())}: a data sheet is a mapping with a `kind`")
    if sensor.get("kind", sheet.value["kind"]) != sheet.value["kind"]:
        raise ScenarioError(
            f"{document.mark(sheet_path)}: `datasheet`: {sensor['datasheet']} is of a "
            f"{sheet.value['kind']}, but this sensor's kind is {sensor['kind']}"
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
    if isinstance(mount, str):
        if mount not in mounts:
            mark = document.mark((*path, "mount"))
            raise ScenarioError(f"{mark}: `mount`: no mount `{mount}`; {nearest(mount, mounts)}")
        document.at(path)["mount"] = mounts[mount]


def _convert(document: Document, schema: type[S]) -> S:
    """Check plain data against a schema and name the first thing that does not fit."""
    try:
        return msgspec.convert(document.value, schema)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at ")
        path = _data_path(where.strip("`"))
        raise ScenarioError(_explained(problem, path, document, schema)) from None


def _data_path(text: str) -> DataPath:
    """Parse msgspec's `$.vehicles[0].name`; `[...]` stands for a value of a mapping."""
    steps = re.findall(r"\.([A-Za-z_]\w*)|\[(\d+)\]", text)
    return tuple(name or int(index) for name, index in steps)


def _explained(problem: str, path: DataPath, document: Document, schema: type) -> str:
    """Return the schema's complaint with its place and, for a misspelt word, the right one."""
    if unknown := re.search(r"contains unknown field `(.*)`", problem):
        key = unknown.group(1)
        names = field_names(schema, document.value, path)
        mark = document.mark((*path, key))
        return f"{mark}: unknown key `{_dotted((*path, key))}`; {nearest(key, names)}"
    mark = document.mark(path)
    if missing := re.search(r"missing required field `(.*)`", problem):
        return f"{mark}: `{_dotted((*path, missing.group(1)))}` is missing; add it"
    if invalid := re.search(r"Invalid value '(.*)'$", problem):
        known = kinds(schema, document.value, path)
        if known:
            word = invalid.group(1)
            return f"{mark}: `{_dotted(path)}`: unknown kind `{word}`; {nearest(word, known)}"
    value = document.at(path)
    given = "" if isinstance(value, dict | list) else f" (given: {value!r})"
    return f"{mark}: `{_dotted(path)}`: {problem[:1].lower()}{problem[1:]}{given}"


def _dotted(path: DataPath) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.lstrip(".") or "scenario"


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
        if vehicle.route is not None:
            _check_speeds(vehicle.route, vehicle.model, document, (*here, "route"))
    time = scenario.time
    if time.mode == "fast" and time.window_ticks < TICK_RATE_HZ / time.clock_rate_hz:
        raise ScenarioError(
            f"{document.mark(('time', 'window_ticks'))}: `time.window_ticks`: {time.window_ticks} "
            f"is less than a period of the clock; expected {TICK_RATE_HZ}/clock_rate_hz or more"
        )
    topics = [s.topic for v in scenario.vehicles for s in (*v.sensors, *v.streams)]
    topics += [scenario.ground_truth_topic(v) for v in scenario.vehicles]
    if twice := [topic for topic in topics if topics.count(topic) > 1]:
        raise ScenarioError(
            f"{document.mark(())}: two sensors share the topic `{twice[0]}`; give each its own"
        )
    heard = [topic for v in scenario.vehicles for topic in msgspec.structs.astuple(v.from_ros)]
    heard = [topic for topic in heard if topic]
    if again := [t for t in heard if t in topics or heard.count(t) > 1]:
        raise ScenarioError(
            f"{document.mark(())}: `from_ros` takes `{again[0]}`, which is another stream's topic; "
            "give each its own"
        )
    try:
        solids(scenario)
    except WorldError as error:
        raise ScenarioError(f"{document.mark(error.path)}: {error}") from None


def _check_wheels(sensor: Sensor, vehicle: Vehicle, document: Document, path: DataPath) -> None:
    """Refuse encoders of wheels that there are not, and odometry of encoders that there are not."""
    if isinstance(sensor, Encoders):
        wheels = [wheel.name for wheel in vehicle.model.wheels]
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


def _check_speeds(route: Route, model: VehicleModel, document: Document, path: DataPath) -> None:
    """Refuse a route that asks for more than the vehicle's wheels can turn."""
    most = model.drive.max_wheel_speed_radps * min(wheel.radius_m for wheel in model.wheels)
    asked: list[tuple[DataPath, float | None]] = [((*path, "speed_mps"), route.speed_mps)]
    if isinstance(route, Waypoints):
        for i, point in enumerate(route.points):
            asked.append(((*path, "points", i, "speed_mps"), point.speed_mps))
    for where, speed in asked:
        if speed is not None and speed > most:
            raise ScenarioError(
                f"{document.mark(where)}: `{_dotted(where)}`: {speed:g} m/s is more than the "
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
