# SPDX-License-Identifier: Apache-2.0
"""Changes of a scenario: of fields, such as `lidar.dropout=0.1` (`--set`), and of its sensors.

A path begins at a field of the scenario or at the name of a vehicle. In a scenario with one vehicle
it may also begin at a field of the vehicle or at the name of a sensor. An element of a list is
chosen by its name or its number. Steps are separated by dots, or by slashes as in the name of a
sensor. Values are YAML.
"""

import argparse
import copy
import json
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from groundlink.core.errors import UserError, did_you_mean
from groundlink.scenario.schema import Scenario, Vehicle

from .document import DataPath, Document, parse, read

FORM = "FIELD=VALUE"


class Change(Protocol):
    """A change of a scenario."""

    def apply_where_written(self, document: Document) -> bool:
        """Change a document whose references were not followed; return whether that is enough."""

    def apply(self, document: Document) -> None:
        """Change a document whose references were followed."""


@dataclass(frozen=True)
class FieldChange:
    """Another value for a field."""

    field: str
    """Path as given, such as `lidar.dropout`."""

    value: Any

    @property
    def text(self) -> str:
        """The change as an argument of `--set`."""
        return f"{self.field}={json.dumps(self.value)}"

    def apply_where_written(self, document: Document) -> bool:
        """Change a document whose references were not followed; return whether that is enough.

        It is not where the field belongs to something that comes from another file, such as a data
        sheet.
        """
        path = self.located(document)
        is_written_here = isinstance(document.at(path[:-1]), dict)
        if is_written_here:
            self._put(document, path)
        return is_written_here

    def apply(self, document: Document) -> None:
        """Change a document whose references were followed.

        Raises
        ------
        UserError
            when there is no such field.
        """
        path = self.located(document)
        for end in range(1, len(path)):
            around = document.at(path[:end])
            if around is None:
                document.at(path[: end - 1])[path[end - 1]] = {}
            elif not isinstance(around, dict | list):
                raise UserError(
                    f"--set {self.field}: `{path[end - 1]}` is {around!r}, which has no fields"
                )
        self._put(document, path)

    def _put(self, document: Document, path: DataPath) -> None:
        document.put(path, Document(copy.deepcopy(self.value), {(): document.mark(path)}))

    def located(self, document: Document) -> DataPath:
        """Return the path of the field in a document.

        Raises
        ------
        UserError
            when there is no such vehicle or element of a list.
        """
        return _located(document, self.field, f"--set {self.field}")


@dataclass(frozen=True)
class SensorRemoval:
    """Leave a sensor out."""

    name: str
    """As `vehicle/sensor`; the vehicle may be left out if there is one only."""

    def apply_where_written(self, document: Document) -> bool:
        """Remove the sensor; return True.

        Raises
        ------
        UserError
            when there is no such sensor.
        """
        self.apply(document)
        return True

    def apply(self, document: Document) -> None:
        """Remove the sensor."""
        option = f"--remove {self.name}"
        path = _located(document, self.name, option)
        if len(path) != 4 or path[2] != "sensors":
            raise UserError(f"{option}: expected VEHICLE/SENSOR, such as rover/camera")
        document.remove(path)


@dataclass(frozen=True)
class SensorAddition:
    """Add a sensor that a file describes as a scenario does."""

    vehicle: str
    file: Path

    def apply_where_written(self, document: Document) -> bool:
        """Add the sensor; return True.

        Raises
        ------
        UserError
            when there is no such vehicle, or the file cannot be read.
        """
        self.apply(document)
        return True

    def apply(self, document: Document) -> None:
        """Add the sensor."""
        option = f"--add {self.vehicle}={self.file}"
        vehicle = _located(document, f"vehicles.{self.vehicle}", option)
        if len(vehicle) != 2:
            raise UserError(f"{option}: expected a vehicle, such as rover=second_lidar.yaml")
        sensors = document.at(vehicle).setdefault("sensors", [])
        sensors.append(None)
        document.put((*vehicle, "sensors", len(sensors) - 1), read(self.file))


def _located(document: Document, field: str, option: str) -> DataPath:
    """Return the path of a field in a document.

    Raises
    ------
    UserError
        when there is none; the line begins with the option.
    """
    path: DataPath = ()
    for step in _from_the_top(document, _steps(field), option):
        value = document.at(path)
        path += (_index(value, step, option) if isinstance(value, list) else step,)
    return path


def _steps(field: str) -> list[str]:
    return re.split(r"[./]", field)


def _from_the_top(document: Document, steps: list[str], option: str) -> list[str]:
    """Return the steps with those that were left out."""
    first = steps[0]
    if first in Scenario.__struct_fields__:
        return steps
    vehicles = [v for v in document.at(("vehicles",)) or () if isinstance(v, dict)]
    names = [str(vehicle.get("name")) for vehicle in vehicles]
    if first in names:
        steps = steps[1:]
    elif len(vehicles) != 1:
        raise UserError(f"{option}: no vehicle `{first}`; {_hint(first, names)}")
    else:
        first = names[0]
    if steps and steps[0] not in Vehicle.__struct_fields__:
        steps = ["sensors", *steps]
    return ["vehicles", first, *steps]


def _index(listed: list[Any], step: str, option: str) -> int:
    """Return the number of an element that is given by name or number."""
    names = [str(each.get("name")) if isinstance(each, dict) else "" for each in listed]
    if step in names:
        return names.index(step)
    if step.isdigit() and int(step) < len(listed):
        return int(step)
    raise UserError(f"{option}: no `{step}`; {_hint(step, names)}")


def _hint(word: str, names: Sequence[str]) -> str:
    return did_you_mean(word, [*names, *Vehicle.__struct_fields__, *Scenario.__struct_fields__])


def add_sensor_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that remove and add sensors to a command."""
    parser.add_argument(
        "--remove",
        action="append",
        default=[],
        metavar="VEHICLE/SENSOR",
        help="leave a sensor out, such as rover/camera; repeatable",
    )
    parser.add_argument(
        "--add",
        action="append",
        default=[],
        metavar="VEHICLE=FILE",
        help="add a sensor that a YAML file describes, with the fields of a scenario's; repeatable",
    )


def all_changes(options: argparse.Namespace) -> list[Change]:
    """Return what `--remove`, `--add` and `--set` mean, in this order.

    Raises
    ------
    UserError
        when an argument has another form.
    """
    additions = []
    for text in options.add:
        vehicle, separator, file = text.partition("=")
        if not (vehicle and separator and file):
            raise UserError(f"--add {text}: expected VEHICLE=FILE, such as rover=second_lidar.yaml")
        additions.append(SensorAddition(vehicle, Path(file)))
    removals = [SensorRemoval(name) for name in options.remove]
    return [*removals, *additions, *field_changes(options.set)]


def field_at(document: Document, path: DataPath) -> str:
    """Return the shortest text with which `--set` names a path of a document.

    Raises
    ------
    UserError
        when there is none, because a step has a dot in its name.
    """
    steps = [_step(document, path[: end + 1]) for end in range(len(path))]
    shorter = []
    if steps[0] == "vehicles":
        shorter = [steps[2:], steps[1:]]
        if steps[2:3] == ["sensors"]:
            shorter = [steps[3:], *shorter[:1], [steps[1], *steps[3:]], *shorter[1:]]
    for each in (*shorter, steps):
        with suppress(UserError):
            if each and FieldChange(text := ".".join(each), None).located(document) == path:
                return text
    raise UserError(
        f"{document.mark(path)}: `--set` cannot name `{'.'.join(steps)}`, since a name in it has a "
        "dot. Fix: rename it"
    )


def _step(document: Document, path: DataPath) -> str:
    """Return the name of the last step of a path, its number without a name."""
    name = element.get("name") if isinstance(element := document.at(path), dict) else None
    return name if isinstance(name, str) and isinstance(path[-1], int) else str(path[-1])


def add_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option to a command."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar=FORM,
        help="run with another value of a field, such as lidar.dropout=0.1; repeatable",
    )


def forwarded(options: argparse.Namespace) -> list[str]:
    """Return the given changes as arguments for another command."""
    return [word for text in options.set for word in ("--set", text)]


def field_changes(texts: Sequence[str]) -> list[FieldChange]:
    """Return what arguments of `--set` mean.

    Raises
    ------
    UserError
        when one has another form.
    """
    return [FieldChange(*_parsed(text)) for text in texts]


def alternatives(text: str) -> list[FieldChange]:
    """Return the changes of `FIELD=VALUE,VALUE,...`, one for each value.

    Raises
    ------
    UserError
        when it has another form.
    """
    field, _, values = text.partition("=")
    _, listed = _parsed(f"{field}=[{values}]")
    if not listed or "=" not in text:
        raise UserError(f"--set {text}: expected {FORM},VALUE,...")
    return [FieldChange(field, value) for value in listed]


def _parsed(text: str) -> tuple[str, Any]:
    field, separator, value = text.partition("=")
    if not separator or not all(_steps(field)):
        raise UserError(f"--set {text}: expected {FORM}, such as lidar.dropout=0.1")
    return field, parse(value or "null", Path(f"--set {text}")).value
