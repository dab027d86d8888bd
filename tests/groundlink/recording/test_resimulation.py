# SPDX-License-Identifier: Apache-2.0
"""Which sensors a changed scenario makes it necessary to simulate again."""

import pytest
from msgspec.structs import replace

from groundlink.core.errors import UserError
from groundlink.loader import load
from groundlink.loader.overrides import field_changes
from groundlink.recording.resimulation import check_drive, sensors_to_simulate
from groundlink.scenario import Scenario

RECORDED = load("indoor_lab")


def changed(*changes: str) -> Scenario:
    return load("indoor_lab", changes=field_changes(changes))


@pytest.mark.parametrize(
    ("changes", "simulated"),
    [
        ((), []),
        (("lidar.dropout=0.2",), ["rover/lidar"]),
        (("lidar.seed=7",), ["rover/lidar"]),
        (("imu.rate_hz=200", "lidar.dropout=0.1"), ["rover/lidar", "rover/imu"]),
        (("encoders.rate_hz=100",), ["rover/encoders"]),
        (("world.weather={rain_mm_per_h: 5.0}",), RECORDED.sensor_names()),
        (("gateway.datagram=mtu", "time.mode=fast", "description=another"), []),
    ],
)
def test_only_what_differs_is_simulated(changes: tuple[str, ...], simulated: list[str]) -> None:
    given = changed(*changes)
    check_drive(RECORDED, given)
    assert sorted(sensors_to_simulate(RECORDED, given)) == sorted(simulated)


def test_what_reads_a_changed_sensor_is_simulated_too() -> None:
    recorded = load("indoor_2d")
    given = load("indoor_2d", changes=field_changes(["encoders.rate_hz=100"]))
    assert set(sensors_to_simulate(recorded, given)) == {"rover/encoders", "rover/odometry"}


def test_a_removed_sensor_makes_no_other_one_differ() -> None:
    [vehicle] = RECORDED.vehicles
    kept = tuple(sensor for sensor in vehicle.sensors if sensor.name != "camera")
    given = replace(RECORDED, vehicles=(replace(vehicle, sensors=kept),))
    check_drive(RECORDED, given)
    assert sensors_to_simulate(RECORDED, given) == []


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ("seed=7", "seed: 1 recorded, 7 repeated"),
        ("vehicles.rover.placement.x_m=1.0", "placement"),
        ("world.room.size_m=[20, 20, 5]", "size_m"),
    ],
)
def test_another_drive_is_refused(change: str, named: str) -> None:
    with pytest.raises(UserError, match=f"more than sensors, weather and light: .*{named}"):
        check_drive(RECORDED, changed(change))
