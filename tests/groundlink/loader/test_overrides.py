# SPDX-License-Identifier: Apache-2.0
"""`--set` changes the field that its path names, before or after references are followed."""

import re
from pathlib import Path
from typing import Any

import pytest

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.document import DataPath, Document, SourceLine
from groundlink.loader.overrides import (
    Change,
    FieldChange,
    SensorAddition,
    SensorRemoval,
    alternatives,
    field_at,
    field_changes,
)
from groundlink.loader.recorded_scenario import with_changes
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario import Scenario


def changed(*texts: str, scenario: str | Path = "indoor_lab_tour") -> Scenario:
    return load(scenario, changes=field_changes(texts))


def at(scenario: Scenario, path: str) -> Any:
    """Return what an attribute path of the first vehicle, or else of the scenario, holds."""
    found: Any = scenario
    for step in path.split("."):
        if isinstance(found, dict):
            found = found[step]
        elif isinstance(found, tuple | list):
            found = next(each for each in found if each.name == step)
        else:
            found = getattr(found, step)
    return found


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("seed=3", "seed", 3),
        ("lidar.dropout=0.25", "vehicles.rover.sensors.lidar.dropout", 0.25),
        ("sensors.lidar.dropout=0.25", "vehicles.rover.sensors.lidar.dropout", 0.25),
        ("rover.lidar.dropout=0.25", "vehicles.rover.sensors.lidar.dropout", 0.25),
        ("vehicles.rover.sensors.lidar.dropout=0.25", "vehicles.rover.sensors.lidar.dropout", 0.25),
        ("vehicles.0.sensors.0.dropout=0.25", "vehicles.rover.sensors.lidar.dropout", 0.25),
        ("route.speed_mps=0.3", "vehicles.rover.route.speed_mps", 0.3),
        ("route={kind: circle, laps: 2}", "vehicles.rover.route.laps", 2),
        ("lidar.datasheet=vlp32c", "vehicles.rover.sensors.lidar.max_range_m", 200.0),
        ("lidar.mount.xyz_m=[0, 0, 1]", "vehicles.rover.sensors.lidar.mount.xyz_m", (0, 0, 1)),
        ("gateway.link.to_ros.loss=0.1", "gateway.link.to_ros.loss", 0.1),
        ("world=yard", "world.name", "yard"),
        ("model.chassis.mass_kg=60", "vehicles.rover.model.chassis.mass_kg", 60),
    ],
)
def test_path_names_a_field(text: str, path: str, value: Any) -> None:
    assert at(scenario := changed(text), path) == value
    assert scenario != changed()


def test_other_fields_of_a_data_sheet_stay() -> None:
    before = at(changed(), "vehicles.rover.sensors.imu.gyroscope")
    after = at(changed("imu.gyroscope.noise_density=0.01"), "vehicles.rover.sensors.imu.gyroscope")
    assert after.noise_density == 0.01
    assert after.bias_instability == before.bias_instability > 0


def test_several_vehicles_are_told_apart_by_name() -> None:
    scenario = changed("second.scanner.dropout=0.5", scenario="two_rovers")
    assert at(scenario, "vehicles.first.sensors.scanner.dropout") != 0.5
    assert at(scenario, "vehicles.second.sensors.scanner.dropout") == 0.5


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("lidar.dropout", "--set lidar.dropout: expected FIELD=VALUE"),
        ("lidar..dropout=1", "--set lidar..dropout=1: expected FIELD=VALUE"),
        ("lidr.dropout=1", "--set lidr.dropout: no `lidr`; did you mean `lidar`?"),
        ("name.short=1", "--set name.short: `name` is 'indoor_lab_tour', which has no fields"),
        ("lidar.dropout=[", "--set lidar.dropout=[:1: not valid YAML"),
        ("lidar.dropout=.nan", "is nan; expected a finite number"),
        ("lidar.dropot=0.1", "`vehicles[0].sensors[0].dropot`; did you mean `dropout`?"),
        ("lidar.dropout=7", "`vehicles[0].sensors[0].dropout`: expected `float` <= 1.0"),
    ],
)
def test_what_names_no_field_is_one_line(text: str, line: str) -> None:
    with pytest.raises(UserError) as caught:
        changed(text)
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_alternatives_are_separated_by_commas() -> None:
    found = alternatives("lidar.mount=mast,{xyz_m: [0, 0, 1]}")
    assert [change.text for change in found] == [
        'lidar.mount="mast"',
        'lidar.mount={"xyz_m": [0, 0, 1]}',
    ]
    assert field_changes([change.text for change in found]) == found


@pytest.mark.parametrize("text", ["lidar.dropout", "lidar.dropout=", "=1,2", "lidar.dropout=1,]"])
def test_alternatives_of_another_form_are_one_line(text: str) -> None:
    with pytest.raises(UserError, match=r"^--set "):
        alternatives(text)


@pytest.mark.parametrize(
    ("path", "text"),
    [
        (("seed",), "seed"),
        (("gateway", "link", "to_ros"), "gateway.link.to_ros"),
        (("vehicles", 0, "route", "laps"), "route.laps"),
        (("vehicles", 0, "sensors", 1, "rate_hz"), "imu.rate_hz"),
        (("vehicles", 0, "sensors", 1), "imu"),
        (("vehicles", 0, "sensors", 2, "rate_hz"), "sensors.route.rate_hz"),
        (("vehicles", 0, "sensors", 3, "faults", 0, "kind"), "3.faults.0.kind"),
        (("vehicles", 0), "rover"),
        (("vehicles",), "vehicles"),
    ],
)
def test_shortest_text_of_a_path_leads_back_to_it(path: DataPath, text: str) -> None:
    names = ("lidar", "imu", "route")
    sensors: list[dict[str, Any]] = [{"name": name, "rate_hz": 1} for name in names]
    sensors.append({"faults": [{"kind": "stuck"}]})
    vehicle = {"name": "rover", "route": {"laps": 1}, "sensors": sensors}
    document = Document({"vehicles": [vehicle], "gateway": {"link": {"to_ros": {}}}})
    assert field_at(document, path) == text
    assert FieldChange(text, None).located(document) == path


def test_paths_of_several_vehicles_begin_with_a_name() -> None:
    sensor = {"name": "imu"}
    vehicles = [{"name": name, "sensors": [sensor]} for name in ("first", "second.one")]
    document = Document({"vehicles": vehicles}, {(): SourceLine(Path("two.yaml"), 1)})
    assert field_at(document, ("vehicles", 0, "sensors", 0, "rate_hz")) == "first.imu.rate_hz"
    with pytest.raises(
        UserError, match=r"two.yaml:1: `--set` cannot name `vehicles\.second\.one\."
    ):
        field_at(document, ("vehicles", 1, "sensors", 0, "rate_hz"))


def removed(name: str) -> Scenario:
    return load("indoor_lab", changes=[SensorRemoval(name)])


@pytest.mark.parametrize("name", ["rover/lidar", "lidar", "rover.lidar"])
def test_a_sensor_is_removed_by_name(name: str) -> None:
    assert removed(name).sensor_names() == ["rover/imu", "rover/encoders", "rover/camera"]


def test_lines_of_other_sensors_stay_when_one_is_removed(tmp_path: Path) -> None:
    text = Path(SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    file = tmp_path / "lab.yaml"
    file.write_text(text.replace("rate_hz: 50.0", "rate_hz: fifty"), encoding="utf-8")
    line = next(n for n, row in enumerate(text.splitlines(), 1) if "kind: encoders" in row)
    with pytest.raises(UserError, match=rf"lab\.yaml:{line}: .*rate_hz"):
        load(file, changes=[SensorRemoval("lidar")])


def test_a_sensor_is_added_from_a_file(tmp_path: Path) -> None:
    file = tmp_path / "second.yaml"
    file.write_text(
        "{kind: lidar_2d, datasheet: lms111, name: front, topic: /front, frame: front_link}",
        encoding="utf-8",
    )
    changes: list[Change] = [SensorAddition("rover", file), *field_changes(["front.dropout=0.5"])]
    added = load("indoor_lab", changes=changes)
    assert added.sensor_names()[-1] == "rover/front"
    assert at(added, "vehicles.rover.sensors.front.dropout") == 0.5
    assert with_changes(load("indoor_lab"), changes) == added


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (SensorRemoval("rover/lidra"), "--remove rover/lidra: no `lidra`; did you mean `lidar`"),
        (SensorRemoval("rover"), "--remove rover: expected VEHICLE/SENSOR"),
        (SensorAddition("tank", Path("a.yaml")), "--add tank=a.yaml: no `tank`"),
        (SensorAddition("rover/imu", Path("a.yaml")), "--add rover/imu=a.yaml: expected a vehicle"),
        (SensorAddition("rover", Path("a.yaml")), "a.yaml: no such file"),
    ],
)
def test_sensors_that_cannot_be_changed_are_one_line(change: Change, line: str) -> None:
    with pytest.raises(UserError, match=re.escape(line)):
        load("indoor_lab", changes=[change])
