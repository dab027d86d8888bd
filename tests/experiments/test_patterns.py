# SPDX-License-Identifier: Apache-2.0
"""LiDARs of several patterns on one mount: each estimator gets the clouds of the named one."""

import pytest

from experiments.estimation.estimators import GICP, KISS, LIDAR_INERTIAL, RKO, Estimator
from experiments.experiment import OUT, ExperimentOptions
from experiments.output.console import Console
from experiments.recording.setups import Setup
from experiments.studies import patterns

OPTIONS = ExperimentOptions(OUT, Console())
TOPIC = ("--lidar-topic", "/points/xt32")
MOUNT = ("--lidar-frame", "xt32_link")


@pytest.mark.parametrize(
    ("estimator", "frame", "more"),
    [
        (KISS, "xt32_link", TOPIC),
        (GICP, "xt32_link", TOPIC),
        (RKO, "xt32_link", (*TOPIC, *MOUNT)),
        (LIDAR_INERTIAL, "imu_link", (*TOPIC, *MOUNT)),
    ],
    ids=lambda value: value.program.name if isinstance(value, Estimator) else "",
)
def test_an_estimator_takes_the_clouds_of_a_lidar(
    estimator: Estimator, frame: str, more: tuple[str, ...]
) -> None:
    own = patterns.on_lidar(estimator, "XT-32")
    assert own.frame == frame
    assert own.settings == (*estimator.settings, *more)


@pytest.mark.parametrize(
    ("setup", "lidars"),
    [(patterns.road(OPTIONS), patterns.ROAD), (patterns.room(OPTIONS), patterns.ROOM)],
    ids=["road", "room"],
)
def test_all_lidars_of_a_vehicle_are_on_one_mount(setup: Setup, lidars: tuple[str, ...]) -> None:
    sensors = setup.document()["vehicles"][0]["sensors"]
    found = [sensor for sensor in sensors if sensor["kind"] == "lidar"]
    assert [sensor["name"] for sensor in found] == [patterns.SHEETS[lidar] for lidar in lidars]
    assert len({str(sensor["mount"]) for sensor in found}) == 1
    assert len({sensor["topic"] for sensor in found}) == len(lidars)
    assert "imu" in {sensor["kind"] for sensor in sensors}


def test_limits_are_of_lidars_on_the_vehicles() -> None:
    assert set(patterns.LIMITS_M["room"]) == set(patterns.ROOM)
    assert set(patterns.LIMITS_M["road"]) | set(patterns.DEFAULTS) == set(patterns.ROAD)
