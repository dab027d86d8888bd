# SPDX-License-Identifier: Apache-2.0
"""Data sheets of sensors: list, find and check them.

A data sheet is found by its folder and listed nowhere else. Fields that it leaves out have their
defaults or are stated by the scenario.
"""

from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from groundlink.scenario.schema import Sensor
from groundlink.scenario.sensor_kinds import sheet_folders

from .document import ScenarioError
from .scenario_files import SHEETS, SHIPPED, find_file, read_datasheet
from .validation_errors import explained

_PLACE = {"name": "sensor", "topic": "/topic", "frame": "frame"}
"""Placeholders for the fields that only a scenario states."""


class CheckedDatasheet(NamedTuple):
    """A data sheet that was checked."""

    file: Path
    kind: str
    title: str
    figures: dict[str, Any]
    """The fields of the sheet, in its order."""

    @property
    def name(self) -> str:
        """Name in a scenario."""
        return self.file.stem

    def sensor(self) -> Sensor:
        """Return the sensor of the sheet, with every default."""
        return msgspec.convert({"kind": self.kind} | _PLACE | self.figures, Sensor)


def shipped_datasheets() -> list[CheckedDatasheet]:
    """Return the data sheets that come with Groundlink, by name.

    Raises
    ------
    ScenarioError
        as `load_datasheet` does.
    """
    return [_checked(file) for file in datasheet_files()]


def datasheet_files() -> list[Path]:
    """Return the files of `shipped_datasheets`."""
    return [
        file
        for folder in (SHIPPED / SHEETS, *sheet_folders())
        for file in sorted(folder.glob("*.yaml"))
    ]


def shipped_figures(kind: str, title: str) -> dict[str, Any] | None:
    """Return the fields of the shipped data sheet with this title; None if none has it."""
    for file in datasheet_files():
        sheet = read_datasheet(file).value
        if (sheet["kind"], sheet.get("datasheet", "")) == (kind, title):
            return {
                name: value for name, value in sheet.items() if name not in ("kind", "datasheet")
            }
    return None


def load_datasheet(given: str) -> CheckedDatasheet:
    """Return the data sheet of this name, or in this file: here, or shipped.

    Raises
    ------
    ScenarioError
        with one line: file, line, field, what was expected and how to mend it.
    """
    return _checked(find_file(given, SHEETS, Path()))


def _checked(file: Path) -> CheckedDatasheet:
    sheet = read_datasheet(file)
    stated: dict[str, Any] = sheet.value
    try:
        msgspec.convert(_PLACE | stated, Sensor)
    except msgspec.ValidationError as error:
        # msgspec reports a missing field only after all given fields are valid.
        if not str(error).startswith("Object missing required field") or " - at " in str(error):
            raise ScenarioError(explained(error, sheet, Sensor)) from None
    title = " ".join(stated.get("datasheet", file.name).split())
    return CheckedDatasheet(file, stated["kind"], title, _figures(stated))


def _figures(stated: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in stated.items() if name not in ("kind", "datasheet")}
