# SPDX-License-Identifier: Apache-2.0
"""Partial scenario: a world or a vehicle alone, as a scenario that can be drawn but not run.

The keys of a file decide what it describes. A vehicle alone stands in a plain world.
"""

from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import Any

from groundlink.core.errors import did_you_mean
from groundlink.importing.file_errors import Warn, ignore_warning
from groundlink.scenario.schema import Scenario

from . import urdf
from .document import Document, ScenarioError, SourceLine, read
from .scenario_files import SHIPPED, load, resolved

FOLDERS = ("worlds", "vehicles", "")
"""Folders of shipped files, in the order of lookup."""

_PLAIN = {
    "name": "plain",
    "materials": {
        "floor": {"color": [0.42, 0.42, 0.40], "texture": "plain", "texture_size_m": 2.0},
        "rubber": {"color": [0.03, 0.03, 0.03]},
    },
    "light": {"kind": "sun", "azimuth_deg": 160.0, "elevation_deg": 50.0},
}


class FileKind(Enum):
    """Contents of a file."""

    WORLD = "world"
    VEHICLE = "vehicle"
    SCENARIO = "scenario"


def load_partial(
    given: str, *, words: Iterable[str] = (), warn: Warn = ignore_warning
) -> tuple[FileKind, Scenario]:
    """Return the world, vehicle or scenario in a file, or the shipped one of this name.

    `words` are further valid inputs, for the hint when nothing matches.

    A world has no vehicles. A vehicle stands in a world without solids, whose material `floor` is
    for a floor that the caller adds.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    file = partial_file(given, words).resolve()
    document = read(file)
    kind = _kind(document)
    if kind is FileKind.SCENARIO:
        return kind, load(file, warn=warn)
    content: dict[str, Any] = {"name": "part", "world": str(file), "vehicles": []}
    if kind is FileKind.VEHICLE:
        content |= {"world": _PLAIN, "vehicles": [{"name": "vehicle", "model": str(file)}]}
    return kind, resolved(Document(content, {(): SourceLine(file, 1)}), warn)


def partial_file(given: str, words: Iterable[str] = ()) -> Path:
    """Return the file of a world, vehicle or scenario: the given one, or the shipped one.

    Raises
    ------
    ScenarioError
        when nothing of this name is shipped.
    """
    if given.endswith((".yaml", ".yml")):
        return Path(given)
    urdf.refuse_bare_urdf(
        Document({"model": given}, {(): SourceLine(Path(Path(given).name), 1)}), ("model",)
    )
    for folder in FOLDERS:
        if (file := SHIPPED / folder / f"{given}.yaml").is_file():
            return file
    shipped = {file.stem for folder in FOLDERS for file in (SHIPPED / folder).glob("*.yaml")}
    raise ScenarioError(
        f"no world, vehicle or scenario `{given}` is shipped; "
        f"{did_you_mean(given, shipped | {*words})}; or pass a file whose name ends in .yaml"
    )


def _kind(document: Document) -> FileKind:
    keys = set(document.value) if isinstance(document.value, dict) else set()
    for kind, typical in (
        (FileKind.SCENARIO, {"world", "vehicles"}),
        (FileKind.VEHICLE, {"drive", "wheels", "urdf", "chassis"}),
        (FileKind.WORLD, {"materials", "solids", "room", "terrain", "map"}),
    ):
        if keys & typical:
            return kind
    raise ScenarioError(
        f"{document.mark(())}: expected a scenario (`vehicles`), a vehicle (`drive`) or a world "
        "(`materials`)"
    )
