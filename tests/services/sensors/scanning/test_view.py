# SPDX-License-Identifier: Apache-2.0
"""Where a head looks: its field of view, the way it turns, and where its lasers point."""

from typing import Any

import numpy as np
import pytest

from groundlink.core.clock import TICK_NANOS
from services.sensors.scanning.scanner import Scan
from tests.services.sensors.lidar import rooms

from . import targets

PLANAR: dict[str, Any] = {
    "firings_per_revolution": 1440,
    "rotation_rate_hz": 40.0,
    "field_of_view_deg": 270.0,
    "start_deg": -135.0,
    "rotation": "counterclockwise",
    "elevations_deg": [0.0],
}


def directions(**spec: Any) -> np.ndarray:
    return np.degrees(targets.azimuths(targets.scenario(**spec)))


def test_a_view_of_less_than_a_turn_has_both_its_ends() -> None:
    azimuth = directions(**PLANAR)
    assert azimuth.shape == (1, 1081)
    np.testing.assert_allclose(azimuth[0], np.linspace(-135, 135, 1081), atol=1e-5)
    seconds = targets.scanner(targets.scenario(**PLANAR)).sweep.seconds[0]
    np.testing.assert_allclose(seconds, np.arange(1081) / (1440 * 40), atol=1e-12)


def test_full_turn_ends_before_the_next() -> None:
    whole = {"field_of_view_deg": 360.0, "firings_per_revolution": 360}
    assert directions(**whole, start_deg=90.0)[0, :3].tolist() == pytest.approx([90, 89, 88])
    assert directions(**whole, start_deg=0.0).shape == (1, 360)
    left = directions(**whole, start_deg=90.0, rotation="counterclockwise")
    assert left[0, :3].tolist() == pytest.approx([90, 91, 92])


@pytest.mark.parametrize(("rotation", "sign"), [("clockwise", -1), ("counterclockwise", 1)])
def test_lasers_may_look_ahead_of_the_head_and_fire_late(rotation: str, sign: int) -> None:
    azimuth = directions(
        field_of_view_deg=360.0,
        firings_per_revolution=360,
        rotation_rate_hz=10.0,
        start_deg=10.0,
        rotation=rotation,
        elevations_deg=[-1.0, 0.0, 1.0],
        azimuth_offsets_deg=[0.0, 1.4, -4.2],
        laser_times_us=[0.0, 0.0, 100.0],  # 0.36 degrees
    )
    expected = 10 + sign * (np.array([[0.0], [1.4], [-4.2 + 0.36]]) + np.arange(360))
    np.testing.assert_allclose((azimuth - expected + 180) % 360, 180, atol=1e-4)


@pytest.mark.parametrize(("rotation", "sign"), [("clockwise", -1), ("counterclockwise", 1)])
def test_a_head_is_where_its_encoder_is_read(rotation: str, sign: int) -> None:
    """At every third firing; from there on it turns evenly, while lasers fire, too."""
    azimuth = directions(
        field_of_view_deg=360.0,
        firings_per_revolution=360,
        rotation_rate_hz=10.0,
        start_deg=10.1,
        rotation=rotation,
        elevations_deg=[0.0, 1.0],
        azimuth_offsets_deg=[0.0, 0.3],
        laser_times_us=[0.0, 50.0],  # 0.18 degrees
        azimuth_resolution_deg=0.7,
        firings_per_azimuth=3,
    )
    read = 0.7 * np.rint((10.1 + sign * 3 * np.arange(120)) / 0.7)
    expected = np.repeat(read, 3) + sign * (np.arange(360) % 3 + np.array([[0.0], [0.3 + 0.18]]))
    np.testing.assert_allclose((azimuth - expected + 180) % 360, 180, atol=1e-4)


def test_rays_meet_what_is_in_their_direction() -> None:
    """A left and a right wall at their own distances; nothing ahead, and no ray back."""
    left = targets.box("gray", (0, 5.5, 0), (400, 1, 400), "left")
    right = targets.box("gray", (0, -3.5, 0), (400, 1, 400), "right")
    made = targets.scenario(left, right, **PLANAR)
    seen, azimuth = targets.measured(made), targets.azimuths(made)[0]
    expected = np.where(azimuth > 0, 5, 3) / np.maximum(np.abs(np.sin(azimuth)), 1e-9)
    met = expected < 100
    np.testing.assert_array_equal(seen.returned[0, 0], met)
    np.testing.assert_allclose(seen.range_m[0, 0][met], expected[met], rtol=1e-5)


def test_a_scan_leaves_with_the_first_state_after_its_last_ray() -> None:
    made = targets.scenario(targets.wall("gray", 5.0), **PLANAR)
    sensor = targets.scanner(made)
    came = [
        (state.tick, scan.nanos // TICK_NANOS, scan.revolution, scan.firings)
        for state in rooms.states(made, targets.at_rest, 30)
        for scan in sensor.take(state)
    ]
    # A revolution takes 10 ticks, the view 7.5 of them.
    assert came == [(8 + 10 * i, 10 * i, i, range(1081)) for i in range(3)]


def test_a_scan_waits_for_its_latest_laser() -> None:
    late = {"elevations_deg": [0.0, 1.0], "laser_times_us": [0.0, 4000.0]}
    sensor = targets.scanner(targets.scenario(**{**PLANAR, **late}))
    # The last ray leaves 1.6 ticks after the 7.5 of the view.
    assert [sensor.blocks.end_tick(i) for i in range(3)] == [10, 20, 30]
    assert sensor.blocks.end_tick(0) > targets.scanner(targets.scenario(**PLANAR)).blocks.end_tick(
        0
    )


def test_blocks_of_a_view_are_its_revolution() -> None:
    way = rooms.driving(speed_mps=2.0, turn_radps=1.0)
    fields = {**PLANAR, "rotation_rate_hz": 10.0, "range_stddev_m": 0.03, "dropout": 0.1}
    whole = rooms.clouds(rooms.scenario(**fields), way, 81)
    blocks = rooms.clouds(rooms.scenario(**fields, block_deg=27.0), way, 81)
    assert (len(whole), len(blocks)) == (2, 20)
    for i, cloud in enumerate(whole):
        own = np.concatenate([block.records() for block in blocks[10 * i : 10 * i + 10]])
        assert len(own) == len(cloud.records()) > 900
        for field in ("x", "y", "z", "intensity"):
            np.testing.assert_array_equal(own[field], cloud.records()[field])
    # Who joins late begins with the next block, in the view or after it.
    for tick in (13, 38):
        made = rooms.scenario(**fields, block_deg=27.0)
        later = rooms.clouds(made, way, 81 - tick, first_tick=tick)
        undisturbed = [b for b in blocks if b.stamp_nanos - rooms.EPOCH_NANOS >= tick * TICK_NANOS]
        assert [bytes(c.points) for c in later] == [bytes(c.points) for c in undisturbed]


@pytest.mark.parametrize("rate_hz", [2.0, 5.0, 10.0])
def test_what_moves_is_the_same_in_blocks_at_the_very_instants_of_states(rate_hz: float) -> None:
    """Each block ends with a ray at a tick, whose next state has not come yet."""

    def shaking(t: float) -> tuple[Any, Any]:
        tick = round(400 * t)
        return (0.4 * (tick % 3), 0.3 * (tick % 2), 0.6), (0.0, 0.0, 0.3 * (tick % 5))

    shell = {"name": "shell", "shape": {"kind": "box", "size_m": [6, 4, 1.8]}, "material": "dark"}
    firings = round(400 / rate_hz)
    fields = {
        **{"elevations_deg": [0.0, 0.1], "laser_times_us": [0.0, 2500.0]},
        **{"firings_per_revolution": firings, "rotation_rate_hz": rate_hz, "others": [shell]},
    }

    def seen(**spec: Any) -> np.ndarray:
        made, scans = rooms.scenario(**fields, **spec), list[Scan]()
        model = rooms.model(made)
        for state in rooms.states(made, rooms.at_rest, firings + 1, others=[shaking]):
            scans += model.scanner.take(state)
        assert all((scan.returns.body >= 0).all() for scan in scans)
        return np.concatenate([scan.returns.true_range_m for scan in scans], axis=-1)

    np.testing.assert_array_equal(seen(block_deg=360 / firings), seen())
