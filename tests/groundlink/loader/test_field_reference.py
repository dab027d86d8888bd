# SPDX-License-Identifier: Apache-2.0
"""The reference of scenario fields: what it says, and how a path finds it."""

from typing import get_args

import pytest

from groundlink.core.errors import UserError
from groundlink.loader.field_reference import UNITS, FieldReference, ScenarioField, Section
from groundlink.loader.json_schema import json_schema
from groundlink.scenario.schema import Sensor
from groundlink.scenario.sensor_kinds import sensor_kinds

REFERENCE = FieldReference(json_schema("scenario"))


def field(path: str) -> ScenarioField:
    (found,) = REFERENCE.find(path)
    assert isinstance(found, ScenarioField)
    return found


def paths(path: str) -> list[str]:
    return [part.path for part in REFERENCE.find(path)]


@pytest.mark.parametrize(
    ("path", "facts"),
    [
        ("seed", ("integer", "", "0", "from 0")),
        ("time.mode", ("`fast`, `lockstep` or `realtime`", "", "realtime", "")),
        ("time.epoch", ("`fixed`, `wall` or `zero` or none", "", "none", "")),
        ("time.clock_rate_hz", ("number", "Hz", "100.0", "above 0 up to 400")),
        ("lidar.dropout", ("number", "", "0.0", "from 0 up to 1")),
        ("lidar.divergence_mrad", ("[number, number]", "mrad", "[0.0, 0.0]", "from 0")),
        ("wheels.rolling_resistance", ("number", "", "0.0", "from 0")),
        ("range.range_stddev_per_m", ("number", "1/m", "0.0", "from 0")),
        ("weather.rain_mm_per_h", ("number", "mm/h", "0.0", "from 0")),
        ("chassis.linear_damping_per_s", ("number", "1/s", "0.0", "from 0")),
        ("sensors.mount", ("text or Mount", "", "its fields' defaults", "")),
        ("sensors.topic", ("text", "", "required", "letters, digits, underscores and slashes")),
        ("encoders.missed_ticks", ("number", "", "0.0", "from 0 up to 1")),
        ("world.materials", ("mapping to Material", "", "{}", "")),
        ("world.furniture", ("list of one of 5 kinds", "", "[]", "")),
        ("fence.points_m", ("list of [number, number]", "m", "required", "2 or more entries")),
        ("range.max_range_m", ("number", "m", "required without a data sheet", "above 0")),
    ],
)
def test_facts_of_a_field(path: str, facts: tuple[str, ...]) -> None:
    found = field(path)
    assert (found.type, found.unit, found.default, found.range) == facts
    assert found.description


@pytest.mark.parametrize(
    ("path", "found"),
    [
        ("lidar.dropout", ["vehicles.sensors.lidar.dropout"]),
        ("vehicles.sensors.lidar", ["vehicles.sensors.lidar"]),
        ("vehicles[0].sensors[12].lidar.dropout", ["vehicles.sensors.lidar.dropout"]),
        ("sensors.lidar", ["vehicles.sensors.lidar"]),
        ("world.terrain", ["world.terrain"]),
        ("crate", ["world.outdoors.crate", "world.actors.form.crate"]),
        ("GatewaySettings.bind", ["gateway.bind"]),
        ("vehicles.model.urdf", ["vehicles.model.urdf"]),
        ("solids.on_ground", ["world.solids.on_ground"]),
        ("scatter.clear_m", ["world.scatter.clear_m"]),
        ("scenario", [""]),
        ("mesh", ["world.solids.shape.mesh"]),
    ],
)
def test_a_path_may_begin_anywhere(path: str, found: list[str]) -> None:
    assert paths(path) == found


def test_a_field_of_several_kinds_is_found_in_each() -> None:
    of_sensors = [f"vehicles.sensors.{kind}.dropout" for kind in ("lidar", "lidar_2d", "range")]
    assert paths("dropout") == [*of_sensors, "vehicles.sensors.lidar.echo_bands.dropout"]
    assert paths("vehicles.sensors.dropout") == of_sensors


def test_a_field_that_all_kinds_share_has_one_path() -> None:
    assert paths("lidar.faults") == paths("camera.faults") == ["vehicles.sensors.faults"]
    assert field("vehicles.sensors").kinds == tuple(sensor_kinds())
    assert field("faults").path == "vehicles.sensors.faults"


def test_every_struct_is_found_by_its_path() -> None:
    assert len(REFERENCE.sections) > 90
    assert not {"Terrain", "Mesh"} & REFERENCE.sections.keys(), "which only the loader makes"
    for section in list(REFERENCE.sections.values())[1:]:
        (found,) = REFERENCE.find(section.path)
        held = REFERENCE.of_field(found) if isinstance(found, ScenarioField) else [found]
        assert section in held, section.path


def test_every_field_of_every_struct_is_found_by_its_path() -> None:
    for section in REFERENCE.sections.values():
        for one in section.fields.values():
            assert one in REFERENCE.find(one.path), one.path


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("lidar.dropuot", "`lidar.dropuot`: unknown field or kind `dropuot`; did you mean `dropou"),
        ("vehicles.sensors.lidr", "`lidr`; did you mean `lidar`?"),
        ("tiem", "`tiem`: unknown field or kind; did you mean `time`?"),
        ("time.mode.fast", "`time.mode.fast`: the field before `fast` has no fields"),
        ("", "unknown field or kind"),
        ("time..mode", "unknown field or kind ``"),
    ],
)
def test_a_wrong_path_is_said_with_the_nearest_word(path: str, said: str) -> None:
    with pytest.raises(UserError) as error:
        REFERENCE.find(path)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_a_unit_is_that_of_the_longest_end() -> None:
    assert {end: UNITS[end] for end in ("_m", "_per_m", "_s", "_mps")} == {
        "_m": "m",
        "_per_m": "1/m",
        "_s": "s",
        "_mps": "m/s",
    }
    assert field("skid_steer.max_angular_acceleration_radps2").unit == "rad/s^2"
    assert field("gnss.drift_time_s").unit == "s"


def test_a_section_has_the_fields_of_its_struct() -> None:
    (lidar,) = REFERENCE.find("lidar")
    assert isinstance(lidar, Section)
    (spec,) = (s for s in get_args(Sensor) if s.__name__ == lidar.title)
    assert list(lidar.fields) == ["kind", *spec.__struct_fields__]
    assert lidar.kind == "lidar"
    assert lidar.description == "A spinning 3D LiDAR."
