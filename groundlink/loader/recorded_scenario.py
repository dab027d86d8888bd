# SPDX-License-Identifier: Apache-2.0
"""Recorded scenarios: changes of a scenario whose references were followed before.

A changed data sheet replaces the figures of the former one. Fields that the scenario states beside
its data sheet stay: those that all kinds of sensors share, and those that differ from the former
sheet, if that is shipped.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from groundlink.scenario.every_sensor import SensorSpec
from groundlink.scenario.schema import Scenario, Sensor
from groundlink.scenario.sensor_kinds import sensor_kinds

from .checks import check_scenario
from .datasheets import shipped_figures
from .document import DataPath, Document, SourceLine
from .material_library import define_soils, with_library_materials
from .namespaces import into_namespaces
from .overrides import Change
from .scenario_files import follow_sensor
from .validation_errors import convert

NAME = Path("the recorded scenario")
"""Stands for the file in error lines."""

SHEET = "datasheet"
"""Field with the title of a sensor's data sheet; in a change, its file."""


def with_changes(scenario: Scenario, changes: Iterable[Change]) -> Scenario:
    """Return a scenario with changes of its fields and sensors.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    document = Document(_plain(scenario), {(): SourceLine(NAME, 1)})
    before = [(sensor, sensor.pop(SHEET)) for _, sensor in _sensors(document)]
    for change in changes:
        change.apply(document)
    titles = {id(sensor): title for sensor, title in before}
    for path, sensor in _sensors(document):
        title = titles.get(id(sensor))
        if title is not None and SHEET in sensor:
            stated = _stated(sensor, title)
            sensor.clear()
            sensor |= stated
        follow_sensor(document, path, sensor, document.at((*path[:2], "model")))
        if title is not None and SHEET not in sensor:
            sensor[SHEET] = title
    into_namespaces(document)
    define_soils(document)
    changed = with_library_materials(convert(document, Scenario))
    check_scenario(changed, document)
    return changed


def _sensors(document: Document) -> Iterator[tuple[DataPath, dict[str, Any]]]:
    for v, vehicle in enumerate(document.at(("vehicles",))):
        for s, sensor in enumerate(vehicle["sensors"]):
            yield ("vehicles", v, "sensors", s), sensor


def _stated(sensor: dict[str, Any], title: str) -> dict[str, Any]:
    """Return the fields that a scenario states beside the data sheet of this title."""
    kind, shared = sensor["kind"], SensorSpec.__struct_fields__
    figures = shipped_figures(kind, title) if title else {}
    if figures is None:
        return {name: value for name, value in sensor.items() if name in ("kind", SHEET, *shared)}
    fields = msgspec.structs.fields(sensor_kinds()[kind].spec)
    stated = {f.name for f in fields if f.name in shared or (f.required and f.name not in figures)}
    required = {name: sensor[name] for name in stated}
    as_listed = _plain(msgspec.convert({"kind": kind} | figures | required, Sensor))
    return {
        name: value
        for name, value in sensor.items()
        if name in ("kind", *stated) or value != as_listed[name]
    }


def _plain(described: msgspec.Struct) -> Any:
    return msgspec.json.decode(msgspec.json.encode(described))
