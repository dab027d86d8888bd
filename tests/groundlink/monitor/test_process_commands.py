# SPDX-License-Identifier: Apache-2.0
import importlib.util
from pathlib import Path

import pytest
from msgspec.structs import replace

from groundlink.core.errors import RequirementError
from groundlink.loader import load
from groundlink.monitor import process_commands
from groundlink.monitor.process_commands import sensor_processes
from groundlink.scenario import Scenario

ROVERS = load(str(Path(__file__).parents[3] / "scenarios" / "two_rovers.yaml"))
LAB = load(str(Path(__file__).parents[3] / "scenarios" / "indoor_lab.yaml"))


def with_process(scenario: Scenario, sensor: str, process: str) -> Scenario:
    """Return a scenario in which a sensor of its first vehicle has a process as given."""
    vehicle, *others = scenario.vehicles
    sensors = tuple(
        replace(one, process=process) if one.name == sensor else one for one in vehicle.sensors
    )
    return replace(scenario, vehicles=(replace(vehicle, sensors=sensors), *others))


def test_light_sensors_of_a_vehicle_share_a_process_and_the_fastest_comes_first() -> None:
    names = LAB.sensor_names()
    found = sensor_processes(LAB, names)
    assert [*found] == ["rover/lidar", "rover/imu+encoders", "rover/camera"]
    shared = ["-m", "services.sensors", "--name", "rover/imu", "--name", "rover/encoders"]
    assert found["rover/imu+encoders"] == shared
    assert found["rover/lidar"] == ["-m", "services.sensors.lidar", "--name", "rover/lidar"]


def test_each_vehicle_has_a_shared_process_of_its_own() -> None:
    found = sensor_processes(ROVERS, ROVERS.sensor_names(), cores=2)
    shared = [name for name in found if "+" in name]
    assert [name.partition("/")[0] for name in shared] == ["first", "second"]


def test_a_sensor_can_have_its_own_process_or_share_one() -> None:
    own = with_process(LAB, "imu", "own")
    assert [*sensor_processes(own, own.sensor_names())] == [
        *("rover/lidar", "rover/imu", "rover/encoders", "rover/camera")
    ]
    shared = with_process(LAB, "lidar", "shared")
    assert "rover/imu+encoders+lidar" in sensor_processes(shared, shared.sensor_names())


def fleet(count: int) -> Scenario:
    """Return a scenario with so many vehicles of the same sensors."""
    first = ROVERS.vehicles[0]
    return replace(ROVERS, vehicles=tuple(replace(first, name=f"v{i}") for i in range(count)))


@pytest.mark.parametrize(
    ("count", "cores", "vehicles"),
    [
        (2, 2, ["v0", "v1"]),
        (5, 2, ["v0..v2", "v3..v4"]),
        (9, 4, ["v0..v2", "v3..v4", "v5..v6", "v7..v8"]),
    ],
)
def test_vehicles_share_processes_of_sensors_if_there_are_fewer_cores(
    count: int, cores: int, vehicles: list[str]
) -> None:
    many = fleet(count)
    found = sensor_processes(many, many.sensor_names(), cores=cores)
    light = "imu+encoders+odometry"
    assert [*found] == [f"{some}/{kind}" for some in vehicles for kind in ("scanner", light)]
    started = [word for command in found.values() for word in command if "/" in word]
    assert sorted(started) == sorted(many.sensor_names())


def test_a_process_of_several_vehicles_has_one_kind_and_no_sensor_with_its_own() -> None:
    many = fleet(3)
    own = with_process(many, "scanner", "own")
    found = sensor_processes(own, own.sensor_names(), cores=1)
    assert [*found] == ["v0/scanner", "v0..v2/imu+encoders+odometry", "v1..v2/scanner"]
    assert found["v0/scanner"][:2] == ["-m", "services.sensors.lidar_2d"]
    assert found["v1..v2/scanner"][:2] == ["-m", "services.sensors"]


def test_only_the_wanted_sensors_run() -> None:
    assert [*sensor_processes(LAB, {"rover/encoders"})] == ["rover/encoders"]


@pytest.mark.parametrize("package", ["mcap", "rosbags", "zstandard"])
def test_unusable_recorder_is_reported_before_the_run(
    package: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Physics would wait for it at the first tick, while a real-time run goes on without it."""
    process_commands.recorder("run.mcap", "lab", "tcp/127.0.0.1:1")
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "importlib.util.find_spec", lambda name: None if name == package else find(name)
    )
    with pytest.raises(RequirementError, match=rf"`{package}` .*groundlink\[record\]"):
        process_commands.recorder("run.mcap", "lab", "tcp/127.0.0.1:1")
