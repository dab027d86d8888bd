# SPDX-License-Identifier: Apache-2.0
"""Changes of a scenario's fields, such as `lidar.dropout=0.1`: the option `--set`.

A path begins at a field of the scenario or at the name of a vehicle. In a scenario with one vehicle
it may also begin at a field of the vehicle or at the name of a sensor. An element of a list is
chosen by its name or its number. Values are YAML.
"""

import argparse
import copy
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from groundlink.core.errors import UserError, did_you_mean
from groundlink.scenario.schema import Scenario, Vehicle

from .document import DataPath, Document, parse

FORM = "FIELD=VALUE"


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
        steps = self.field.split(".")
        path: DataPath = ()
        for step in self._from_the_top(document, steps):
            value = document.at(path)
            path += (self._index(value, step) if isinstance(value, list) else step,)
        return path

    def _from_the_top(self, document: Document, steps: list[str]) -> list[str]:
        """Return the steps with those that were left out."""
        first = steps[0]
        if first in Scenario.__struct_fields__:
            return steps
        vehicles = [v for v in document.at(("vehicles",)) or () if isinstance(v, dict)]
        names = [str(vehicle.get("name")) for vehicle in vehicles]
        if first in names:
            steps = steps[1:]
        elif len(vehicles) != 1:
            raise UserError(f"--set {self.field}: no vehicle `{first}`; {self._hint(first, names)}")
        else:
            first = names[0]
        if steps and steps[0] not in Vehicle.__struct_fields__:
            steps = ["sensors", *steps]
        return ["vehicles", first, *steps]

    def _index(self, listed: list[Any], step: str) -> int:
        """Return the number of an element that is given by name or number."""
        names = [str(each.get("name")) if isinstance(each, dict) else "" for each in listed]
        if step in names:
            return names.index(step)
        if step.isdigit() and int(step) < len(listed):
            return int(step)
        raise UserError(f"--set {self.field}: no `{step}`; {self._hint(step, names)}")

    @staticmethod
    def _hint(word: str, names: Sequence[str]) -> str:
        return did_you_mean(word, [*names, *Vehicle.__struct_fields__, *Scenario.__struct_fields__])


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
    if not separator or not all(field.split(".")):
        raise UserError(f"--set {text}: expected {FORM}, such as lidar.dropout=0.1")
    return field, parse(value or "null", Path(f"--set {text}")).value
