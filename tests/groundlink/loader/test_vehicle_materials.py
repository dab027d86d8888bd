# SPDX-License-Identifier: Apache-2.0
"""A vehicle brings its materials into every world."""

from pathlib import Path

import pytest

from groundlink.loader import ScenarioError, load
from groundlink.loader.scenario_files import SHIPPED

SCENARIO = """\
name: test
world:
  name: nowhere
  materials: {{{listed}}}
  solids:
    - name: floor
      shape: {{kind: box, size_m: [40, 40, 1]}}
      material: rubber
      position_m: [0, 0, -0.5]
vehicles:
  - {{name: first, model: first.yaml, placement: {{x_m: -9}}}}
  - {{name: second, model: second.yaml, placement: {{x_m: 9}}}}
"""
RUBBER = "  rubber: {reflectivity: 0.05,"


def write(folder: Path, *, listed: str = "", second: str = RUBBER) -> Path:
    """Write a scenario with two rovers, whose rubber may differ."""
    rover = (SHIPPED / "vehicles" / "rover.yaml").read_text(encoding="utf-8")
    assert RUBBER in rover
    (folder / "first.yaml").write_text(rover, encoding="utf-8")
    (folder / "second.yaml").write_text(rover.replace(RUBBER, second), encoding="utf-8")
    file = folder / "test.yaml"
    file.write_text(SCENARIO.format(listed=listed), encoding="utf-8")
    return file


def test_a_world_needs_none_of_a_vehicles_materials(tmp_path: Path) -> None:
    scenario = load(write(tmp_path))
    assert scenario.world.materials["rubber"].reflectivity == 0.05
    assert scenario.world.materials == scenario.vehicles[1].model.materials


def test_a_worlds_own_materials_win(tmp_path: Path) -> None:
    other = "  rubber: {reflectivity: 0.1,"
    scenario = load(write(tmp_path, listed="rubber: {reflectivity: 0.7}", second=other))
    assert scenario.world.materials["rubber"].reflectivity == 0.7


def test_two_vehicles_may_not_mean_different_things(tmp_path: Path) -> None:
    file = write(tmp_path, second="  rubber: {reflectivity: 0.1,")
    with pytest.raises(ScenarioError) as caught:
        load(file)
    text = str(caught.value)
    assert text.startswith(f"{tmp_path / 'second.yaml'}:")
    assert f"another `rubber` is defined by the vehicle at {tmp_path / 'first.yaml'}:" in text


def test_material_mistake_has_its_place(tmp_path: Path) -> None:
    file = write(tmp_path)
    for name in ("first", "second"):
        model = tmp_path / f"{name}.yaml"
        model.write_text(model.read_text().replace(RUBBER, "  rubber: {reflectivity: 5,"))
    with pytest.raises(ScenarioError, match=r"first\.yaml:\d+: `world\.materials.*<= 1"):
        load(file)


def test_all_shipped_vehicles_agree_on_what_they_are_made_of(tmp_path: Path) -> None:
    vehicles = "\n".join(
        f"  - {{name: {file.stem}, model: {file.stem}, placement: {{x_m: {20 * i}}}}}"
        for i, file in enumerate(sorted((SHIPPED / "vehicles").glob("*.yaml")))
    )
    file = tmp_path / "test.yaml"
    world = SCENARIO.partition("vehicles:")[0].format(listed="").replace("40, 40", "400, 40")
    file.write_text(f"{world}vehicles:\n{vehicles}\n", encoding="utf-8")
    assert len(load(file).vehicles) >= 4
