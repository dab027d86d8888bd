# SPDX-License-Identifier: Apache-2.0
"""What an experiment has other than a shipped scenario is in the file, and nothing else is."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from experiments.estimation import vocabulary
from experiments.experiment import OUT, ExperimentOptions
from experiments.output.console import Console
from experiments.recording.setups import CRAWL_MPS, Setup, waypoints
from experiments.studies import indoor_cameras, indoors, patterns
from groundlink.loader import load

PLAIN = Setup(name="plain", scenario="indoor_paper", seconds=10.0)
OPTIONS = ExperimentOptions(OUT, Console())


def sensors(setup: Setup) -> dict[str, Any]:
    return {sensor["name"]: sensor for sensor in setup.document()["vehicles"][0]["sensors"]}


def test_sensors_are_changed_left_out_and_added() -> None:
    added = {"kind": "imu", "topic": "/imu2", "frame": "imu_link"}
    setup = replace(PLAIN, sensors={"scanner": None, "camera": {"rate_hz": 30.0}, "second": added})
    before, after = sensors(PLAIN), sensors(setup)
    assert set(after) == set(before) - {"scanner"} | {"second"}
    assert after["camera"] == before["camera"] | {"rate_hz": 30.0}
    assert after["second"] == {"name": "second", **added}
    assert after["imu"] == before["imu"]


def test_what_is_said_of_all_sensors_holds_for_those_of_the_scenario() -> None:
    setup = replace(PLAIN, sensors={"*": {"repair": {"resend": 0.5}}, "imu": None})
    assert {s["repair"]["resend"] for s in sensors(setup).values()} == {0.5}
    assert "imu" not in sensors(setup)


def test_a_bad_link_and_its_repair_are_in_the_scenario(tmp_path: Path) -> None:
    setup = replace(PLAIN, link={"seed": 3, "to_ros": {"loss": 0.05}}, repair={"resend": 0.5})
    scenario = load(setup.write(tmp_path, {"peer": "127.0.0.1:7999"}))
    assert scenario.gateway.link is not None
    assert scenario.gateway.link.to_ros.loss == 0.05
    assert scenario.gateway.peer == "127.0.0.1:7999"
    assert all(sensor.repair for sensor in scenario.vehicles[0].sensors)


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"seconds": 11.0},
        {"sensors": {"imu": None}},
        {"top": {"bodies": {"rate_hz": 2.0}}},
    ],
    ids=lambda change: next(iter(change)),
)
def test_what_a_recording_depends_on_names_it(change: dict[str, Any]) -> None:
    assert PLAIN.digest() == PLAIN.digest()
    assert replace(PLAIN, **change).digest() != PLAIN.digest()


@pytest.mark.parametrize(
    "setup",
    [
        *(
            replace(PLAIN, sensors=sensors)
            for sensors in (
                indoors.SCANS,
                indoors.CLOUDS,
                indoor_cameras.MONO,
                indoor_cameras.RGBD,
            )
        ),
        patterns.road(OPTIONS),
        patterns.room(OPTIONS),
        vocabulary.OUTDOORS,
        vocabulary.INDOORS,
    ],
)
def test_every_setup_is_a_scenario_with_its_truth(tmp_path: Path, setup: Setup) -> None:
    scenario = load(setup.write(tmp_path))
    assert scenario.vehicles[0].ground_truth.push
    assert scenario.time.lockstep == "ros"
    assert scenario.vehicles[0].route


def test_a_way_begins_at_a_crawl_straight_ahead() -> None:
    placement = {"x_m": 1.0, "y_m": 2.0, "yaw_deg": 90.0}
    route = waypoints(placement, [{"x_m": 1.0, "y_m": 9.0}], 2.0, 0.3)
    crawl, goal = route["points"]
    assert (crawl["x_m"], crawl["y_m"]) == pytest.approx((1.0, 2.3))
    assert crawl["speed_mps"] == CRAWL_MPS
    assert (route["speed_mps"], goal) == (2.0, {"x_m": 1.0, "y_m": 9.0})
