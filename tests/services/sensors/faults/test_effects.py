# SPDX-License-Identifier: Apache-2.0
"""Each kind of fault, by what it does to the readings of each sensor."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pymap3d
import pytest
from scipy import stats

from groundlink.messages.base import BusMessage, Imu, PointCloud, Reading, State, WheelEncoders
from groundlink.messages.ground_truth import (
    Detections2D,
    Detections3D,
    LabeledPoints,
    LabelTable,
)
from groundlink.messages.imagery import LaserScan, RadarDetections, Range
from groundlink.messages.navigation import NavSatFix, Odometry
from groundlink.scenario.faults import (
    KINDS,
    Bias,
    Delay,
    Drift,
    Drop,
    Fault,
    NoiseBurst,
    OccludedSector,
    Off,
    RateChange,
    Stuck,
    TimeJump,
)
from groundlink.scenario.sensor_kinds import sensor_kinds
from services.sensors.faults.effects import EFFECTS
from services.sensors.faults.offsets import changes_of, cover_of
from tests.services.sensors.broken import (
    EPOCH_NANOS,
    READINGS,
    RING,
    Counts,
    Repeats,
    changed,
    points,
    seconds,
    states,
    wrapped,
)

Values = Callable[[Any], Any]


def fix_enu_m(fix: NavSatFix) -> list[float]:
    start = READINGS[NavSatFix]
    assert isinstance(start, NavSatFix)
    place = (fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
    return list(
        pymap3d.geodetic2enu(*place, start.latitude_deg, start.longitude_deg, start.altitude_m)
    )


def yaw(odometry: Odometry) -> float:
    _, _, z, w = odometry.orientation
    return 2 * math.atan2(z, w)


def cloud_range_m(cloud: PointCloud | RadarDetections) -> np.ndarray:
    return np.linalg.norm([cloud.records()[axis] for axis in "xyz"], axis=0)


def scan_range_m(scan: LaserScan) -> np.ndarray:
    return np.frombuffer(scan.ranges_m, np.float32)


VALUES: dict[tuple[type[Reading], str], tuple[Values, Any, Any]] = {
    (PointCloud, "range"): (cloud_range_m, 0.25, 1e-6),
    (RadarDetections, "range"): (cloud_range_m, 0.25, 5e-6),
    (RadarDetections, "velocity"): (lambda frame: frame.records()["velocity"], 0.5, 1e-6),
    (LaserScan, "range"): (lambda scan: scan_range_m(scan)[[0, 1, 7]], 0.25, 1e-6),
    (Imu, "acceleration"): (lambda imu: imu.linear_acceleration_mps2, (0.5, -0.25, 2.0), 1e-12),
    (Imu, "angular_velocity"): (lambda imu: imu.angular_velocity_radps, (0.5, 0.0, -1.0), 1e-12),
    (WheelEncoders, "ticks"): (lambda reading: reading.ticks[:1], (7.3, 0.0), 0),
    (Odometry, "position"): (lambda odometry: odometry.position_m, (1.0, 2.0, 0.0), 1e-12),
    (Odometry, "yaw"): (yaw, 0.3, 1e-12),
    (NavSatFix, "position"): (fix_enu_m, (30.0, -20.0, 5.0), 1e-3),
    (Range, "range"): (lambda reading: reading.range_m, 0.25, 1e-12),
}
"""What a person would read of each quantity, a bias of it, and how exactly that is found."""


def test_every_sensor_has_its_quantities_and_every_kind_its_effect() -> None:
    for kind in sensor_kinds().values():
        message = kind.streams[""]
        assert list(kind.spec.quantities) == list(changes_of(message)), kind
        assert not kind.cover or callable(cover_of(message))
    found = {(message, name) for message in READINGS for name in changes_of(message)}
    assert found == set(VALUES)
    labels = {LabeledPoints, LabelTable, Detections2D, Detections3D}
    assert set(READINGS) | labels == set(Reading.__subclasses__())
    assert not any(changes_of(message) for message in labels)
    assert set(EFFECTS) == set(KINDS.values())


@pytest.mark.parametrize(("message", "quantity"), VALUES, ids=lambda v: getattr(v, "__name__", v))
def test_a_bias_is_added_and_a_drift_grows(message: type[Reading], quantity: str) -> None:
    value, numbers, tolerance = VALUES[message, quantity]
    start = value(READINGS[message])
    span: dict[str, Any] = {"at_s": 0.1, "for_s": 0.2, "quantity": quantity}
    per_s = tuple(10 * x for x in numbers) if isinstance(numbers, tuple) else 10 * numbers
    cases: list[tuple[Fault, Callable[[float], float]]] = [
        (Bias(value=numbers, **span), lambda at_s: 1.0),
        (Drift(per_s=per_s, **span), lambda at_s: 10 * (at_s - 0.1)),
    ]
    for fault, share in cases:
        for _, reading in changed(wrapped(Repeats(READINGS[message]), message, fault), 160):
            at = round(seconds(reading), 4)
            moved = np.multiply(numbers, share(at) if 0.1 <= at < 0.3 else 0.0)
            moved = moved[: np.size(start)] if np.ndim(moved) else moved
            if message is WheelEncoders:
                moved = np.rint(moved)
            assert np.abs(np.subtract(value(reading), start) - moved).max() <= tolerance


@pytest.mark.parametrize(("message", "quantity"), VALUES, ids=lambda v: getattr(v, "__name__", v))
def test_noise_has_its_deviation_and_depends_on_the_seed_only(
    message: type[Reading], quantity: str
) -> None:
    value, _, _ = VALUES[message, quantity]
    stddev = 200.0 if message is WheelEncoders else 0.02
    fault = NoiseBurst(stddev=stddev, quantity=quantity)
    runs = [
        changed(wrapped(Repeats(READINGS[message]), message, fault, seed=seed), 1600)
        for seed in (1, 1, 2)
    ]
    assert runs[0] == runs[1] != runs[2]
    start = np.atleast_1d(value(READINGS[message]))
    errors = np.array([np.atleast_1d(value(reading)) - start for _, reading in runs[0]])
    # Chi-square of the sum of squares, two-sided, at one in a million.
    low, high = stats.chi2.ppf([5e-7, 1 - 5e-7], errors.size)
    assert low < np.sum((errors / stddev) ** 2) < high
    assert stats.kstest(errors.ravel() / stddev, "norm").pvalue > 1e-4


def test_two_noises_that_begin_at_different_times_are_different() -> None:
    def errors(at_s: float) -> list[float]:
        model = wrapped(Repeats(READINGS[Range]), Range, NoiseBurst(stddev=0.1, at_s=at_s))
        return [r.range_m for _, r in changed(model, 400) if seconds(r) > 0.5]  # type: ignore[attr-defined]

    assert errors(0.0) != errors(0.25)


def test_invalid_ranges_stay_and_limits_hold() -> None:
    model = wrapped(Repeats(READINGS[LaserScan]), LaserScan, Bias(value=1.0))
    ranges = scan_range_m(changed(model, 1)[0][1])  # type: ignore[arg-type]
    expected = [2.0, 3.0, np.inf, np.inf, -np.inf, np.nan, 1.3, 6.0]
    assert np.array_equal(ranges, np.float32(expected), equal_nan=True)
    model = wrapped(Repeats(READINGS[LaserScan]), LaserScan, Bias(value=-1.0))
    ranges = scan_range_m(changed(model, 1)[0][1])  # type: ignore[arg-type]
    expected = [-np.inf, 1.0, np.inf, 8.5, -np.inf, np.nan, -np.inf, 4.0]
    assert np.array_equal(ranges, np.float32(expected), equal_nan=True)


def test_points_that_would_come_behind_the_sensor_are_gone() -> None:
    cloud = PointCloud(0, "lidar", points((1, 0, 0), (0, 3, 0), (0, 0, 0)).tobytes())  # type: ignore[arg-type]
    model = wrapped(Repeats(cloud), PointCloud, Bias(value=-2.0))
    [point] = changed(model, 1)[0][1].records()  # type: ignore[attr-defined]
    assert (point["x"], point["y"], point["z"], point["ring"]) == (0, 1, 0, 1)


def test_counters_wrap() -> None:
    model = wrapped(Repeats(READINGS[WheelEncoders]), WheelEncoders, Bias(value=(0.0, 2.0)))
    assert changed(model, 1)[0][1].ticks == (100, -(2**63) + 1)  # type: ignore[attr-defined]


def test_a_receiver_without_a_fix_gets_none() -> None:
    nothing = NavSatFix(0, "gps", -1, 1, math.nan, math.nan, math.nan, bytes(72), 0)  # type: ignore[arg-type]
    model = wrapped(Repeats(nothing), NavSatFix, Bias(value=3.0), NoiseBurst(stddev=1.0))
    [(_, fix)] = changed(model, 1)
    assert math.isnan(fix.latitude_deg)  # type: ignore[attr-defined]
    assert math.isnan(fix.altitude_m)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("sector", "kept_deg"),
    [
        ((-35, 35), range(40, 330, 10)),
        ((325, 395 - 360), range(40, 330, 10)),
        ((35, -35), [*range(0, 40, 10), *range(330, 360, 10)]),
        ((85, 125), [*range(0, 90, 10), *range(130, 360, 10)]),
        ((0, 360), []),
    ],
)
def test_a_covered_sector_returns_nothing(sector: tuple[float, float], kept_deg: list[int]) -> None:
    fault = OccludedSector(from_deg=sector[0], to_deg=sector[1])
    [(_, cloud)] = changed(wrapped(Repeats(READINGS[PointCloud]), PointCloud, fault), 1)
    records = cloud.records()  # type: ignore[attr-defined]
    assert records.tolist() == points(*RING)[[d // 10 for d in kept_deg]].tolist() or not kept_deg
    azimuth = np.rint(np.degrees(np.arctan2(records["y"], records["x"])) % 360)
    assert azimuth.tolist() == [*kept_deg]


def test_a_covered_sector_of_a_scan_meets_nothing() -> None:
    fault = OccludedSector(from_deg=-100, to_deg=0)
    [(_, scan)] = changed(wrapped(Repeats(READINGS[LaserScan]), LaserScan, fault), 1)
    # Rays at -180, -135, -90 ... 135 degrees.
    expected = [1.0, 2.0, np.inf, np.inf, np.inf, np.nan, 0.3, 5.0]
    assert np.array_equal(scan_range_m(scan), np.float32(expected), equal_nan=True)  # type: ignore[arg-type]
    shine = np.frombuffer(scan.intensities, np.float32)  # type: ignore[attr-defined]
    assert shine.tolist() == [1, 2, 0, 0, 0, 6, 7, 8]


ALL = [pytest.param(m, id=m.__name__) for m in READINGS]


def taken(message: type[Reading], *faults: Fault, ticks: int = 200) -> list[tuple[int, BusMessage]]:
    return changed(wrapped(Counts(READINGS[message]), message, *faults), ticks)


def numbers(run: list[tuple[int, BusMessage]]) -> list[int]:
    return [int(message.frame) for _, message in run]  # type: ignore[attr-defined]


@pytest.mark.parametrize("message", ALL)
def test_off_and_stuck(message: type[Reading]) -> None:
    run = taken(message, Off(at_s=0.1, for_s=0.2))
    assert numbers(run) == [*range(10), *range(30, 50)]
    run = taken(message, Stuck(at_s=0.1, for_s=0.2))
    assert numbers(run) == [*range(10), *([10] * 20), *range(30, 50)]
    assert [round(100 * seconds(reading)) for _, reading in run] == [*range(50)]


@pytest.mark.parametrize("message", ALL)
def test_a_clock_that_jumps(message: type[Reading]) -> None:
    for offset in (-2.5, 0.015):
        run = taken(message, TimeJump(at_s=0.1, for_s=0.2, offset_s=offset))
        assert numbers(run) == [*range(50)]
        for number, (tick, reading) in enumerate(run):
            wrong = offset if 10 <= number < 30 else 0.0
            stamp = reading.stamp_nanos - EPOCH_NANOS  # type: ignore[attr-defined]
            assert stamp == round((number * 0.01 + wrong) * 1e9)
            assert tick == 4 * number
            assert round(100 * seconds(reading)) == number


@pytest.mark.parametrize("message", ALL)
def test_delayed_readings_come_in_order_with_their_stamps(message: type[Reading]) -> None:
    run = taken(message, Delay(at_s=0.1, for_s=0.2, delay_s=0.05))
    assert numbers(run) == [*range(50)]
    # From the end of the fault on what comes waits for what is before it.
    late = [20 if 10 <= n < 30 else max(0, 4 * (29 + 5 - n)) for n in range(50)]
    assert [tick - 4 * n for n, (tick, _) in enumerate(run)][:30] == [0] * 10 + late[10:30]
    assert [tick for tick, _ in run][30:35] == [136] * 5
    assert [tick for tick, _ in run][35:] == [4 * n for n in range(35, 50)]


@pytest.mark.parametrize(("delay_s", "ticks"), [(0.0001, 1), (0.0025, 1), (0.003, 2), (0.005, 2)])
def test_a_reading_comes_at_the_first_tick_that_is_not_before_its_delay(
    delay_s: float, ticks: int
) -> None:
    run = taken(Imu, Delay(delay_s=delay_s))
    assert {tick - 4 * n for n, (tick, _) in enumerate(run)} == {ticks}


def test_a_share_is_lost() -> None:
    run = taken(Imu, Drop(share=0.3), ticks=16000)
    got = numbers(run)
    assert got == sorted(set(got))
    assert stats.binomtest(4000 - len(got), 4000, 0.3).pvalue > 1e-6
    lost = np.ones(4000, bool)
    lost[got] = False
    # Losses do not go together.
    assert stats.binomtest(int((lost[1:] & lost[:-1]).sum()), 3999, 0.09).pvalue > 1e-6
    assert numbers(taken(Imu, Drop(share=1.0))) == []
    assert numbers(taken(Imu, Drop(share=0.3), ticks=16000)) == got


@pytest.mark.parametrize(
    ("rate_hz", "kept"),
    [
        (50, range(0, 100, 2)),
        (10, range(0, 100, 10)),
        (30, [-(-10 * i // 3) for i in range(30)]),
        (99, [*range(0, 1), *range(2, 100)]),
    ],
)
def test_a_lower_rate_keeps_every_so_many(rate_hz: float, kept: list[int]) -> None:
    run = taken(Imu, RateChange(rate_hz=rate_hz), ticks=400)
    assert numbers(run) == [*kept]


def test_a_lower_rate_begins_with_its_first_reading_however_they_are_spaced() -> None:
    class Bursts(Counts):
        """Three readings, then none for as long, as of a scanner that looks ahead in blocks."""

        def readings(self, state: State) -> Iterator[BusMessage]:
            return (r for r in super().readings(state) if round(100 * seconds(r)) % 6 < 3)

    model = wrapped(Bursts(READINGS[LaserScan]), LaserScan, RateChange(rate_hz=40.0, at_s=0.1))
    kept = [number for number in numbers(changed(model, 200)) if number >= 10]
    # From 0.12 s on there are readings; events are 25 ms apart from 0.1 s on.
    assert kept == [12, 13, 18, 20, 24, 25, 30, 36, 38, 42, 43, 48]


def test_rounded_stamps_are_accepted() -> None:
    model = wrapped(Counts(READINGS[Imu], 30.0), Imu, RateChange(rate_hz=15.0))
    run = changed(model, 400)
    assert [round(30 * seconds(reading)) for _, reading in run] == [*range(0, 30, 2)]


def test_faults_act_in_the_order_of_a_device_whatever_they_are_given_in() -> None:
    faults = (
        Stuck(at_s=0.1),
        Bias(value=1.0, at_s=0.2),
        TimeJump(offset_s=1.0),
        RateChange(rate_hz=50.0),
    )
    runs = [taken(Range, *order) for order in (faults, faults[::-1])]
    assert runs[0] == runs[1]
    # Stuck before the bias: what is repeated has none. Rates go by true time.
    assert {reading.range_m for _, reading in runs[0]} == {1.5}  # type: ignore[attr-defined]
    assert len(runs[0]) == 25


def test_two_of_a_kind_add_up() -> None:
    [(_, reading)] = taken(Range, Bias(value=0.25), Bias(value=0.5), ticks=1)
    assert reading.range_m == 2.25  # type: ignore[attr-defined]


def test_other_messages_are_not_affected() -> None:
    class WithTruth(Repeats):
        def readings(self, state: Any) -> Any:
            for reading in super().readings(state):
                yield reading
                yield state

    run = changed(wrapped(WithTruth(READINGS[Imu]), Imu, Off(), Delay(delay_s=0.1)), 20)
    assert [message for _, message in run] == list(states(range(0, 20, 4)))
