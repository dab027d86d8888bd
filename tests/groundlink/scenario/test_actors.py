# SPDX-License-Identifier: Apache-2.0
"""Actors in files: what is allowed, and what a mistake is told as."""

from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.json_schema import json_schema
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scene.bodies import link_bodies
from groundlink.scene.build import solids


def written(folder: Path, *changes: tuple[tuple[str | int, ...], Any]) -> Path:
    """Write a scenario of the laboratory with these actors, changed at some places."""
    world = yaml.safe_load((SHIPPED / "worlds" / "lab.yaml").read_text())
    world["actors"] = yaml.safe_load(Path(__file__).with_name("actors.yaml").read_text())
    for path, value in changes:
        part = world["actors"]
        for step in path[:-1]:
            part = part[step]
        part[path[-1]] = value
    vehicle = {"name": "rover", "model": "rover", "placement": {"x_m": -4.6}}
    scenario = {"name": "it", "world": world, "vehicles": [vehicle]}
    file = folder / "it.yaml"
    file.write_text(yaml.safe_dump(scenario, sort_keys=False))
    return file


def test_actors_of_all_kinds_are_read(tmp_path: Path) -> None:
    file = written(tmp_path)
    scenario = load(file)
    assert [actor.name for actor in scenario.world.actors] == ["visitor", "gate", "parcel"]
    assert [actor.kind for actor in scenario.world.actors] == ["person", "door", "parcel"]
    assert link_bodies(scenario)[-3:] == ["visitor", "gate", "parcel"]
    assert "visitor" not in {solid.name for solid in solids(scenario)}
    validator = jsonschema.Draft202012Validator(json_schema("scenario"))
    assert not list(validator.iter_errors(yaml.safe_load(file.read_text())))


@pytest.mark.parametrize(
    ("path", "value", "problem"),
    [
        ((0, "form", "kind"), "persn", "person"),
        ((0, "form", "shirt"), "plastik", "did you mean `plastic`"),
        ((0, "motion", "speed_mps"), 0, "speed_mps"),
        ((0, "motion", "points_m"), [[0, 0]], "points_m"),
        ((0, "motion", "points_m"), [[1, 1], [1, 1]], "two consecutive `points_m` are equal"),
        ((0, "name"), "gate", "two bodies are named `gate`"),
        ((1, "motion", "every_s"), 3, "`every_s` is shorter than all `swings` together"),
        ((2, "motion", "mass_kg"), -1, "mass_kg"),
        ((2, "motion", "at_m"), [-4.6, 0, 0.2], "`rover` starts inside `parcel`"),
        ((2, "form", "parts"), [], "parts"),
    ],
)
def test_a_mistake_has_one_line(
    tmp_path: Path, path: tuple[str | int, ...], value: object, problem: str
) -> None:
    file = written(tmp_path, (path, value))
    with pytest.raises(UserError) as caught:
        load(file)
    line = str(caught.value)
    assert problem in line
    assert line.startswith(f"{file}:")
    assert "\n" not in line
