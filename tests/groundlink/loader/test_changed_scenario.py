# SPDX-License-Identifier: Apache-2.0
"""A changed scenario, written as a file elsewhere, loads as the scenario with the changes."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.changed_scenario import changed_text, value_of
from groundlink.loader.overrides import FieldChange
from groundlink.loader.scenario_files import SHIPPED


@pytest.mark.parametrize(
    ("scenario", "changes"),
    [
        ("indoor_lab_tour", {}),
        ("indoor_lab_tour", {"lidar.dropout": 0.3, "seed": 7}),
        ("indoor_lab_tour", {"lidar.datasheet": "vlp32c", "lidar.mount": "imu"}),
        ("indoor_lab_tour", {"imu.gyroscope.noise_density": 0.001, "imu.rate_hz": 200.0}),
        ("indoor_lab_tour", {"model.chassis.mass_kg": 20.0, "route.speed_mps": 0.3}),
        (
            "indoor_lab_tour",
            {"model.chassis.mass_kg": 20.0, "model.drive.max_wheel_torque_nm": 9.0},
        ),
        ("indoor_lab", {"world.room.size_m": [20.0, 20.0, 3.0]}),
        ("two_rovers", {"second.scanner.dropout": 0.25}),
        ("scanned_room", {"lidar.faults": [{"kind": "off", "at_s": 1.0}]}),
    ],
)
def test_written_scenario_loads_as_the_changed_one(
    scenario: str, changes: dict[str, Any], tmp_path: Path
) -> None:
    given = [FieldChange(field, value) for field, value in changes.items()]
    file = tmp_path / "changed.yaml"
    file.write_text(changed_text(scenario, given, tmp_path), encoding="utf-8")
    assert load(file) == load(scenario, changes=given)


def test_files_beside_the_scenario_are_named_from_the_new_folder(tmp_path: Path) -> None:
    own, out = tmp_path / "own", tmp_path / "results" / "of_mine"
    for folder in ("worlds", "vehicles"):
        (own / folder).mkdir(parents=True)
    out.mkdir(parents=True)
    shutil.copy(SHIPPED / "worlds" / "lab.yaml", own / "worlds" / "own_lab.yaml")
    shutil.copy(SHIPPED / "vehicles" / "rover.yaml", own / "vehicles" / "own_rover.yaml")
    scenario = own / "scenario.yaml"
    scenario.write_text(
        "name: mine\nworld: own_lab\n"
        "vehicles:\n  - {name: rover, model: vehicles/own_rover.yaml, sensors: []}\n"
    )
    for changes in ([FieldChange("seed", 2)], [FieldChange("model.chassis.mass_kg", 20.0)]):
        file = out / "changed.yaml"
        file.write_text(changed_text(scenario, changes, out), encoding="utf-8")
        assert load(file) == load(scenario, changes=changes)
    assert "world: ../../own/worlds/own_lab.yaml" in file.read_text()


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("seed", 1),
        ("lidar.dropout", 0.0),
        ("lidar.mount", "mast"),
        ("lidar.datasheet", "sensors/vlp16_paper.yaml"),
        ("route.speed_mps", 0.6),
        ("world.weather.fog_visibility_m", None),
    ],
)
def test_value_of_a_field_as_written_or_loaded(field: str, value: object) -> None:
    assert value_of(field, "indoor_lab_tour", load("indoor_lab_tour")) == value


def test_field_of_no_vehicle_is_refused() -> None:
    with pytest.raises(UserError, match="no `camera`"):
        value_of("camera.rate_hz", "indoor_lab_tour", load("indoor_lab_tour"))
