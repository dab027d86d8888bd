# SPDX-License-Identifier: Apache-2.0
"""What a radar reports of plates and vehicles whose range and speed are known."""

import math
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray

from groundlink.core.clock import TICK_NANOS
from groundlink.core.frames import quaternion_from_rpy
from groundlink.messages.base import State, encode
from groundlink.messages.imagery import RadarDetections
from groundlink.scenario.every_sensor import Mount
from groundlink.scenario.schema import Scenario
from groundlink.world.weather import Weather
from services.sensors.faults.point_effects import cover, offset_range
from services.sensors.radar.fault_effects import offset_velocity
from services.sensors.radar.model import RadarModel
from services.sensors.radar.spec import Radar
from tests.services.sensors.sheets import from_sheet
from tests.services.sensors.yards import box, moving, resting, yard

AHEAD = Mount((1.0, 0.0, 0.5))
"""Beyond the wheels, 0.5 m above the base."""

FIELDS: dict[str, Any] = {
    **{"name": "radar", "topic": "/radar", "frame": "radar_link", "mount": AHEAD},
    **{"horizontal_fov_deg": 30.0, "vertical_fov_deg": 10.0, "ray_step_deg": 0.1},
    **{"max_range_m": 100.0, "full_range_rcs_dbsm": -30.0, "range_resolution_m": 0.5},
    **{"azimuth_resolution_deg": 3.0, "elevation_resolution_deg": 5.0},
    **{"velocity_resolution_mps": 0.2, "rate_hz": 400.0},
}


def plate(distance_m: float, size_m: float = 0.4, y_m: float = 0.0) -> Any:
    """Return a plate across the axis, its face at this distance from the sensor."""
    return box("plate", (0.1, size_m, size_m), (1.05 + distance_m, y_m, 0.5))


def radar(made: Scenario, **fields: Any) -> RadarModel:
    return RadarModel(made, made.vehicles[0], Radar(**{**FIELDS, **fields}))


def driving(speed_mps: float, ticks: int = 2, yaw_rate: float = 0.0) -> list[State]:
    seconds = np.arange(ticks) * TICK_NANOS / 1e9
    turns = np.array([quaternion_from_rpy(0, 0, yaw_rate * second) for second in seconds])
    return list(moving(np.outer(seconds * speed_mps, (1, 0, 0)), turns))


def last(model: RadarModel, run: list[State]) -> NDArray[np.void]:
    frames: list[RadarDetections] = []
    for state in run:
        frames += model.readings(state)
        assert model.settled_tick() == state.tick
    return frames[-1].records()


def test_a_plate_at_rest_has_its_range_and_no_velocity() -> None:
    whole = {"range_resolution_m": 5.0, "azimuth_resolution_deg": 40.0}
    for distance_m in (12.0, 52.0, 93.0):
        found = last(radar(yard(plate(distance_m)), **whole), resting(2))
        best = found[np.argmax(found["snr"])]
        assert best["x"] == pytest.approx(distance_m, abs=0.05)
        assert best["velocity"] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("speed_mps", [20.0, -5.0])
def test_the_world_approaches_a_radar_that_drives(speed_mps: float) -> None:
    found = last(radar(yard(plate(30.0))), driving(speed_mps))
    assert len(found)
    np.testing.assert_allclose(found["velocity"], -speed_mps, atol=0.05)


def test_the_doppler_of_the_static_world_falls_with_the_cosine() -> None:
    wall = box("wall", (1, 80, 20), (40, 0, 0))
    made = yard(replace(wall, orientation=quaternion_from_rpy(0, 0, 0.6)))
    found = last(radar(made, horizontal_fov_deg=100.0, full_range_rcs_dbsm=-60.0), driving(10.0))
    range_m = np.sqrt(sum(found[axis].astype(float) ** 2 for axis in "xyz"))
    assert np.ptp(found["y"] / range_m) > 0.7
    np.testing.assert_allclose(found["velocity"], -10 * found["x"] / range_m, atol=0.3)


def test_a_turning_sensor_moves_by_its_lever_arm() -> None:
    """The mount 1 m ahead moves sideways, and the world stands: only the side approaches."""
    side = box("side", (80, 1, 20), (0, 20.5, 0))
    mount = Mount((1.0, 0.0, 0.5), (0, 0, 90))
    found = last(radar(yard(side), mount=mount), driving(0.0, yaw_rate=2.0))
    best = found[np.argmax(found["snr"])]
    assert best["velocity"] == pytest.approx(-2.0, abs=0.05)


def test_another_vehicle_has_its_own_velocity() -> None:
    made = yard()
    rover = made.vehicles[0]
    made = replace(made, vehicles=(rover, replace(rover, name="other")))
    run = []
    for own, other in zip(
        driving(10.0), moving([(20.0, 0, 0), (20 + 16 * 2.5e-3, 0, 0)]), strict=True
    ):
        both = {"rover": own.vehicles["rover"], "other": other.vehicles["rover"]}
        run.append(replace(own, vehicles=both))
    found = last(radar(made), run)
    near = found[np.argmax(found["snr"])]
    assert near["velocity"] == pytest.approx(6.0, abs=0.05)


def test_a_small_plates_snr_falls_with_the_fourth_power_of_its_range() -> None:
    whole = {
        **{"range_resolution_m": 20.0, "azimuth_resolution_deg": 40.0, "ray_step_deg": 0.02},
        **{"horizontal_fov_deg": 4.0, "vertical_fov_deg": 4.0, "elevation_resolution_deg": 0.0},
        **{"velocity_resolution_mps": 50.0, "full_range_rcs_dbsm": -60.0},
    }
    powers = []
    for distance_m in (20.0, 40.0, 80.0):
        found = last(radar(yard(plate(distance_m)), **whole), resting(1))
        powers.append(found["snr"].max())
        assert len(found) == 1
    assert powers[0] - powers[1] == pytest.approx(40 * math.log10(2), abs=0.6)
    assert powers[1] - powers[2] == pytest.approx(40 * math.log10(2), abs=0.6)


def test_metal_is_brighter_and_rain_dims() -> None:
    def best(made: Scenario, **fields: Any) -> tuple[float, float]:
        found = last(radar(made, **fields), resting(1))
        strongest = found[np.argmax(found["snr"])]
        return float(strongest["snr"]), float(strongest["rcs"])

    made = yard(plate(50.0))
    snr_db, rcs_dbsm = best(made)
    metal_db, metal_dbsm = best(made, reflectivities={"gray": 1.0})
    assert metal_db - snr_db == pytest.approx(10, abs=0.3)
    assert metal_dbsm - rcs_dbsm == pytest.approx(10, abs=0.3)
    # The face of 0.16 m^2 in the lobe of its roughness, and what it scatters.
    assert metal_dbsm == pytest.approx(10 * math.log10(0.16 * (0.84 * 50 + 0.64)), abs=1.0)
    downpour = replace(made, world=replace(made.world, weather=Weather(rain_mm_per_h=50.0)))
    assert snr_db - best(downpour)[0] == pytest.approx(2 * 0.05 * 18.8, abs=0.2)


def test_the_same_seed_gives_the_same_bytes() -> None:
    def frames(seed: int, begin: int = 0) -> list[bytes]:
        noisy = {"false_alarms": 2.0, "fluctuation": "swerling1", "rate_hz": 50.0}
        model = radar(replace(yard(plate(20.0)), seed=seed), **noisy)
        run = driving(3.0, ticks=80)[begin:]
        return [encode(frame) for state in run for frame in model.readings(state)]

    assert len(frames(1)) == 10
    assert frames(1) == frames(1)
    assert not set(frames(1)) & set(frames(2))
    assert frames(1, begin=30) == frames(1)[4:]
    # The first frame after a restart has no velocities and is omitted.
    assert frames(1, begin=32) == frames(1)[5:]


def test_faults_shift_and_cover() -> None:
    made = yard(plate(20.0, 8.0))
    (frame,) = radar(made).readings(resting(1)[0])
    before = frame.records()
    moved = offset_range(frame, lambda n, _: np.full((n, 1), 2.0)).records()
    ahead = np.sqrt(sum(before[axis].astype(float) ** 2 for axis in "xyz"))
    after = np.sqrt(sum(moved[axis].astype(float) ** 2 for axis in "xyz"))
    np.testing.assert_allclose(after, ahead + 2, rtol=1e-5)
    faster = offset_velocity(frame, lambda n, _: np.full((n, 1), 1.5)).records()
    np.testing.assert_allclose(faster["velocity"], before["velocity"] + 1.5, rtol=1e-5)
    assert not len(offset_range(frame, lambda n, _: np.full((n, 1), -50.0)).records())
    left_over = cover(frame, 0.0, math.pi).records()
    assert np.array_equal(left_over, before[before["y"] < 0])
    assert 0 < len(left_over) < len(before)


@pytest.mark.parametrize(
    ("wrong", "problem"),
    [
        ({"min_range_m": 200.0}, "`min_range_m` is 200; expected less than `max_range_m`, 100"),
        ({"max_velocity_mps": -60.0}, "spans 0 m/s; expected more than `velocity_resolution_mps`"),
        ({"ray_step_deg": 0.01}, "makes 3000000 rays; expected 200000 at most"),
    ],
)
def test_impossible_devices_are_refused(wrong: dict[str, Any], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        Radar(**{**FIELDS, **wrong})


@pytest.mark.parametrize("sheet", ["ars408_near", "ars408_far"])
def test_the_sheets_see_a_wall_as_it_is(sheet: str) -> None:
    spec = replace(from_sheet(Radar, sheet), mount=AHEAD, rate_hz=400.0)
    assert spec.datasheet
    assert spec.max_velocity_mps - spec.min_velocity_mps == pytest.approx(600 / 3.6, abs=0.1)
    made = yard(box("wall", (1, 40, 40), (41.5, 0, 0.5)))
    found = last(RadarModel(made, made.vehicles[0], spec), driving(10.0, ticks=10))
    best = found[np.argmax(found["snr"])]
    assert best["x"] == pytest.approx(40.0, abs=4 * spec.range_stddev_m + spec.range_resolution_m)
    assert best["velocity"] == pytest.approx(-10.0, abs=4 * spec.velocity_stddev_mps + 0.1)
