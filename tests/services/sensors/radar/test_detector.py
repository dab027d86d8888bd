# SPDX-License-Identifier: Apache-2.0
"""Detection probability, errors, cells, aliasing and false alarms against closed forms."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from services.sensors.noise.random_streams import RandomStreams
from services.sensors.radar.detector import Detector, Echoes
from services.sensors.radar.echoes import RadarEquation
from services.sensors.radar.spec import Radar

FIELDS: dict[str, Any] = {
    **{"name": "radar", "topic": "/radar", "frame": "radar_link"},
    **{"horizontal_fov_deg": 120.0, "vertical_fov_deg": 20.0, "max_range_m": 100.0},
    **{"full_range_rcs_dbsm": 0.0, "range_resolution_m": 0.5, "azimuth_resolution_deg": 3.0},
    **{"elevation_resolution_deg": 5.0, "velocity_resolution_mps": 0.2},
}
UNIT_SNR = 1e8


def detector(**fields: Any) -> Detector:
    spec = Radar(**{**FIELDS, **fields})
    return Detector(spec, RadarEquation(UNIT_SNR), RandomStreams(1, "rover/radar"))


def echoes(
    range_m: float = 20.1, y: float = 0.01, z: float = 0.01, velocity: float = 1.1, db: float = 60.0
) -> Echoes:
    return Echoes._make(np.array([x]) for x in (range_m, y, z, velocity, 10 ** (db / 10)))


def frames(made: Detector, echo: Echoes, count: int) -> NDArray[np.void]:
    return np.concatenate([made.detections(echo, tick) for tick in range(count)])


@pytest.mark.parametrize("snr_db", [8.0, 12.0, 15.0])
def test_detection_probability_is_marcums(snr_db: float) -> None:
    snr, threshold = 10 ** (snr_db / 10), 10**1.2
    seen = len(frames(detector(), echoes(db=snr_db), 2000)) / 2000
    # Marcum's Q_1(a, b) is the tail of a noncentral chi-squared law with two degrees of freedom.
    expected = stats.ncx2.sf(2 * threshold, 2, 2 * snr)
    assert seen == pytest.approx(expected, abs=0.05)


def test_fluctuating_echoes_follow_swerlings_first_case() -> None:
    made = detector(fluctuation="swerling1")
    seen = len(frames(made, echoes(db=20.0), 2000)) / 2000
    assert seen == pytest.approx(math.exp(-(10**1.2) / (1 + 100)), abs=0.04)


def clutter(ranges: int, db: float = 40.0) -> Echoes:
    """Return echoes of the same power in neighboring range cells."""
    ones = np.ones(ranges)
    range_m = np.linspace(10, 10 + 0.5 * (ranges - 1), ranges)
    return Echoes(range_m, 0 * ones, 0 * ones, ones, 10 ** (db / 10) * ones)


def test_even_clutter_is_detected_as_cell_averaging_has_it() -> None:
    made = detector(fluctuation="swerling1", cfar_cells=4, threshold_db=4.0, max_detections=10_000)
    seen = len(made.detections(clutter(160), 0)) / 160
    for tick in range(1, 60):
        seen += len(made.detections(clutter(160), tick)) / 160
    assert seen / 60 == pytest.approx((1 + 10**0.4 / 8) ** -8, abs=0.02)
    fixed = detector(fluctuation="swerling1", threshold_db=4.0, max_detections=10_000)
    assert len(fixed.detections(clutter(160), 0)) > 155


def test_a_target_is_seen_in_clutter_that_is_not() -> None:
    echo = clutter(40)
    echo.snr[20] *= 100
    (found,) = detector(cfar_cells=4).detections(echo, 0)
    assert found["x"] == pytest.approx(20.0, abs=0.05)
    moving = Echoes._make((*(values.copy() for values in clutter(40)),))
    moving.velocity_mps[20] = 5.0
    (found,) = detector(cfar_cells=4, threshold_db=12.0).detections(moving, 0)
    assert found["velocity"] == pytest.approx(5.0, abs=0.05)


def test_thermal_noise_shifts_values_by_the_cell_over_the_root_of_the_snr() -> None:
    found = frames(detector(), echoes(db=20.0), 2000)
    thermal = 1 / math.sqrt(2 * 100)
    range_m = np.sqrt(sum(found[axis].astype(float) ** 2 for axis in "xyz"))
    assert np.std(range_m) == pytest.approx(0.5 * thermal, rel=0.1)
    assert np.std(found["velocity"]) == pytest.approx(0.2 * thermal, rel=0.1)
    angle = math.sin(math.radians(3)) / 1.6 * thermal
    assert np.std(found["y"] / range_m) == pytest.approx(angle, rel=0.1)
    assert np.mean(range_m) == pytest.approx(20.1, abs=0.005)
    assert np.mean(found["velocity"]) == pytest.approx(1.1, abs=0.002)


def test_the_devices_own_errors_come_on_top() -> None:
    found = frames(detector(velocity_stddev_mps=0.5, range_stddev_m=0.3), echoes(), 1000)
    assert np.std(found["velocity"]) == pytest.approx(0.5, rel=0.1)
    assert np.std(found["x"]) == pytest.approx(0.3, rel=0.1)


def test_velocities_beyond_the_interval_appear_at_its_other_end() -> None:
    made = detector(min_velocity_mps=-10.0, max_velocity_mps=20.0)
    for true_mps, seen_mps in ((25.0, -5.0), (-12.0, 18.0), (19.0, 19.0), (61.0, 1.0)):
        (found,) = made.detections(echoes(velocity=true_mps), 0)
        assert found["velocity"] == pytest.approx(seen_mps, abs=0.01)


def test_a_cell_has_one_detection_with_the_sum_of_powers() -> None:
    def pair(**apart: float) -> Echoes:
        both = echoes(), echoes(**apart)
        return Echoes._make(map(np.concatenate, zip(*both, strict=True)))

    made = detector()
    (found,) = made.detections(pair(range_m=20.2), 0)
    assert found["snr"] == pytest.approx(60 + 10 * math.log10(2), abs=0.05)
    assert math.hypot(found["x"], found["y"], found["z"]) == pytest.approx(20.15, abs=0.01)
    for apart in ({"range_m": 21.0}, {"y": 0.1}, {"z": 0.15}, {"velocity": 1.5}):
        assert len(made.detections(pair(**apart), 0)) == 2
    flat = detector(elevation_resolution_deg=0.0)
    (found,) = flat.detections(pair(z=0.15), 0)
    assert found["z"] == 0


def test_the_cross_section_is_what_the_range_and_the_snr_say() -> None:
    (found,) = detector().detections(echoes(range_m=50.0, db=40.0), 0)
    assert found["snr"] == pytest.approx(40, abs=0.3)
    assert found["rcs"] == pytest.approx(40 - 80 + 40 * math.log10(50), abs=0.3)


def test_false_alarms_come_at_their_rate_anywhere_and_weak() -> None:
    made = detector(false_alarms=3.0)
    none = Echoes._make(np.empty(0) for _ in range(5))
    found = frames(made, none, 1000)
    assert len(found) == pytest.approx(3000, abs=4 * math.sqrt(3000))
    assert found["snr"].min() >= 12.0
    assert np.mean(10 ** (found["snr"] / 10)) == pytest.approx(10**1.2 + 1, abs=0.1)
    assert np.ptp(found["velocity"]) > 110
    assert found["y"].min() < -30 < 30 < found["y"].max()


def test_of_too_many_the_strongest_are_kept() -> None:
    ranges = np.arange(10.0, 40.0)
    many = Echoes._make((ranges, *np.zeros((3, 30)), 10 ** (5 + np.arange(30) / 10)))
    found = detector(max_detections=4).detections(many, 0)
    np.testing.assert_allclose(found["x"], [36, 37, 38, 39], atol=0.05)
