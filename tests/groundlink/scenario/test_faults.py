# SPDX-License-Identifier: Apache-2.0
"""Faults in a scenario: what they say, when they are, and what is refused with its place."""

from pathlib import Path

import msgspec
import pytest
import yaml

from groundlink.loader import ScenarioError, load
from groundlink.scenario import faults

EXAMPLES: list[faults.Fault] = [
    faults.Off(),
    faults.Stuck(at_s=5.0, for_s=2.0),
    faults.Bias(value=(0.0, 0.0, 0.3), quantity="acceleration"),
    faults.Drift(per_s=0.1, at_s=1.0),
    faults.NoiseBurst(stddev=0.1),
    faults.TimeJump(offset_s=-2.0),
    faults.Delay(delay_s=0.5),
    faults.Drop(share=0.2),
    faults.RateChange(rate_hz=5.0),
    faults.OccludedSector(from_deg=-30.0, to_deg=45.0),
]

SCENARIO = """\
name: faulty
world: worlds/lab.yaml
vehicles:
  - name: rover
    model: vehicles/rover.yaml
    sensors:
      - kind: imu
        name: imu
        topic: /imu
        frame: imu
        faults:
          - FAULT
      - {kind: encoders, name: encoders, topic: /wheels, frame: base_link}
"""


def loaded(folder: Path, fault: str) -> faults.Fault:
    file = folder / "faulty.yaml"
    file.write_text(SCENARIO.replace("FAULT", fault), encoding="utf-8")
    [found] = load(file).vehicles[0].sensors[0].faults
    return found


def test_every_kind_is_here() -> None:
    assert {type(example) for example in EXAMPLES} == set(faults.KINDS.values())


@pytest.mark.parametrize("fault", EXAMPLES, ids=lambda fault: fault.kind)
def test_they_print_as_a_scenario_has_them(fault: faults.Fault) -> None:
    assert str(fault).startswith("{kind: ")
    assert msgspec.convert(yaml.safe_load(str(fault)), faults.Fault) == fault  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("at_s", "for_s", "begin", "end"),
    [
        (0.0, None, 0, None),
        (0.1, 0.2, 40, 120),
        (0.0025, 0.0025, 1, 2),
        (0.001, 0.001, 1, 2),
        (0.0026, 0.0025, 2, 3),
        (12.345, 5.0, 4938, 6938),
    ],
)
def test_a_fault_is_on_for_whole_ticks(
    at_s: float, for_s: float | None, begin: int, end: int | None
) -> None:
    fault = faults.Off(at_s=at_s, for_s=for_s)
    assert (fault.begin_tick, fault.end_tick) == (begin, end)
    assert [fault.is_on(tick) for tick in (begin - 1, begin)] == [False, True]
    if end is not None:
        assert [fault.is_on(tick) for tick in (end - 1, end)] == [True, False]


def test_every_tick_comes_back_from_its_seconds() -> None:
    for tick in (*range(3000), 10**6 + 1, 10**8 + 7):
        assert faults.Off(at_s=tick / 400).begin_tick == tick


def test_the_width_of_a_sector() -> None:
    widths = {(-30, 45): 75, (350, 10): 20, (45, -30): 285, (0, 360): 360, (7, 7): 360}
    for (begin, end), width in widths.items():
        assert faults.OccludedSector(from_deg=begin, to_deg=end).width_deg == width


def test_yaml_takes_off_for_a_word(tmp_path: Path) -> None:
    assert loaded(tmp_path, "{kind: off, at_s: 3}") == faults.Off(at_s=3.0)


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("{kind: stuk}", ["kind", "`stuk`", "did you mean `stuck`?"]),
        ("{kind: bias}", ["faults[0].value", "is missing"]),
        ("{kind: bias, valu: 3}", ["valu", "did you mean `value`?"]),
        ("{kind: bias, value: [1, 2]}", ["value", "2 numbers; expected one, or 3 (x, y, z)"]),
        ("{kind: bias, value: 1, quantity: gyro}", ["quantity", "angular_velocity"]),
        ("{kind: drift, per_s: .inf}", ["`per_s` is inf"]),
        ("{kind: off, at_s: -1}", ["at_s", "-1"]),
        ("{kind: off, for_s: 0}", ["for_s", "> 0"]),
        ("{kind: drop, share: 1.5}", ["share", "1.5"]),
        ("{kind: delay, delay_s: 3}", ["delay_s", "<= 1.0"]),
        ("{kind: rate_change, rate_hz: 500}", ["rate_hz", "less than the declared 400 Hz"]),
        ("{kind: occluded_sector, from_deg: 0, to_deg: 9}", ["kind", "does not look around"]),
    ],
)
def test_what_a_sensor_cannot_have_is_refused_with_its_place(
    tmp_path: Path, fault: str, words: list[str]
) -> None:
    with pytest.raises(ScenarioError) as caught:
        loaded(tmp_path, fault)
    for word in [f"{tmp_path / 'faulty.yaml'}:12:", *words]:
        assert word in str(caught.value)


def test_encoders_take_one_number_for_each_wheel(tmp_path: Path) -> None:
    file = tmp_path / "faulty.yaml"
    of_wheels = SCENARIO.replace("frame: base_link}", "frame: base_link, faults: [BIAS]}")
    of_wheels = of_wheels.replace("FAULT", "{kind: stuck}")
    file.write_text(of_wheels.replace("BIAS", "{kind: bias, value: [1, 2, 3, 4]}"), "utf-8")
    load(file)
    file.write_text(of_wheels.replace("BIAS", "{kind: bias, value: [1, 2]}"), "utf-8")
    with pytest.raises(ScenarioError, match=r"2 numbers; expected one, or 4 \(one for each wheel"):
        load(file)
