# SPDX-License-Identifier: Apache-2.0
"""A world or a vehicle by itself, as a scenario to look at, or a whole one.

Rule: which of them a file is, its keys tell. What is added so that it makes a scenario (a plain
floor under a vehicle) stands here and nowhere else. Such a scenario cannot run.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from pathlib import Path
from typing import Any

from groundlink.core.errors import nearest
from groundlink.importing.files import Tell, silent
from groundlink.scenario.schema import Scenario

from . import urdf
from .document import Document, Mark, ScenarioError, read
from .load import SHIPPED, load, resolved

FOLDERS = ("worlds", "vehicles", "")
"""Of what is shipped, in the order in which names are looked for."""

_PLAIN = {
    "name": "plain",
    "materials": {
        "floor": {"color": [0.42, 0.42, 0.40], "texture": "plain", "texture_size_m": 2.0},
        "rubber": {"color": [0.03, 0.03, 0.03]},
    },
    "light": {"kind": "sun", "azimuth_deg": 160.0, "elevation_deg": 50.0},
}


class Kind(Enum):
    """What a file describes."""

    WORLD = "world"
    VEHICLE = "vehicle"
    SCENARIO = "scenario"


def load_part(
    given: str, *, words: Iterable[str] = (), tell: Tell = silent
) -> tuple[Kind, Scenario]:
    """Return the world, vehicle or scenario in a file, or the shipped one of this name.

    `words` are what else the user could have given, for the hint where there is none.

    A world has no vehicles around; a vehicle is in a world without solids, whose material `floor`
    is for what one wants to put it on.

    Raises
    ------
    ScenarioError
        as `load` does.
    """
    file = part_file(given, words).resolve()
    document = read(file)
    kind = _kind(document)
    if kind is Kind.SCENARIO:
        return kind, load(file, tell=tell)
    content: dict[str, Any] = {"name": "part", "world": str(file), "vehicles": []}
    if kind is Kind.VEHICLE:
        content |= {"world": _PLAIN, "vehicles": [{"name": "vehicle", "model": str(file)}]}
    return kind, resolved(Document(content, {(): Mark(file, 1)}), tell)


def part_file(given: str, words: Iterable[str] = ()) -> Path:
    """Return the file of a world, vehicle or scenario: the given one, or the shipped one.

    Raises
    ------
    ScenarioError
        when nothing of this name is shipped.
    """
    if given.endswith((".yaml", ".yml")):
        return Path(given)
    urdf.must_not_be_alone(
        Document({"model": given}, {(): Mark(Path(Path(given).name), 1)}), ("model",)
    )
    for folder in FOLDERS:
        if (file := SHIPPED / folder / f"{given}.yaml").is_file():
            return file
    shipped = {file.stem for folder in FOLDERS for file in (SHIPPED / folder).glob("*.yaml")}
    raise ScenarioError(
        f"no world, vehicle or scenario `{given}` is shipped; "
        f"{nearest(given, shipped | {*words})}; or give a file with a `.yaml` name"
    )


def _kind(document: Document) -> Kind:
    keys = set(document.value) if isinstance(document.value, dict) else set()
    for kind, telling in (
        (Kind.SCENARIO, {"world", "vehicles"}),
        (Kind.VEHICLE, {"drive", "wheels", "urdf", "chassis"}),
        (Kind.WORLD, {"materials", "solids", "room", "terrain"}),
    ):
        if keys & telling:
            return kind
    raise ScenarioError(
        f"{document.mark(())}: this is no scenario (`vehicles`), no vehicle (`drive`) and no world "
        "(`materials`)"
    )
