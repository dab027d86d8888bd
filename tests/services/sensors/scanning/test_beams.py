# SPDX-License-Identifier: Apache-2.0
"""Beams with a width: what they meet of several things, and which of it is reported."""

import math
from typing import Any

import numpy as np
import pytest

from services.sensors.scanning.returns import Returns
from tests.services.sensors.lidar import rooms

from . import targets

WIDE: dict[str, Any] = {"divergence_mrad": [8.0, 8.0], "rays_per_beam": 16}
"""4 by 4 rays, 2 mrad apart; 8 cm at 10 m."""

AXIS: dict[str, Any] = {"field_of_view_deg": 0.001, "start_deg": 0.0}
"""One firing, along x."""

NEAR_M, FAR_M = 10.0, 13.0


def half_covered(
    covered_m: float, *, near: str = "gray", far: str = "gray", **spec: Any
) -> Returns:
    """Look along x at a far wall, of which a near one covers what is left of y = `covered_m`."""
    screen = targets.box(near, (NEAR_M + 0.05, covered_m + 5, 0), (0.1, 10, 10), "screen")
    wall = targets.wall(far, FAR_M)
    return targets.returns(screen, wall, **{**AXIS, **WIDE, **spec})


def reported(seen: Returns) -> list[tuple[float, int]]:
    """Return range, rounded to a centimeter, and label of each return of the one beam."""
    assert seen.range_m.shape[1:] == (1, 1)
    return [
        (round(float(range_m), 2), int(label))
        for range_m, label, returned in zip(
            seen.range_m[:, 0, 0], seen.label[:, 0, 0], seen.returned[:, 0, 0], strict=True
        )
        if returned
    ]


SCREEN, WALL = (NEAR_M, 1), (FAR_M, 2)


@pytest.mark.parametrize(
    ("covered_m", "fields", "expected"),
    [
        # Left of y = 0 are 8 of 16 rays, left of -2 cm 12, left of 2 cm 4.
        (0.0, {"returns": "strongest"}, [SCREEN]),
        (0.0, {"returns": "last"}, [WALL]),
        (0.0, {"returns": "dual"}, [WALL, SCREEN]),
        # The wall is 1.69 times weaker by its distance, so it takes more than its share.
        (0.02, {"returns": "strongest"}, [WALL]),
        (0.02, {"returns": "dual"}, [WALL, SCREEN]),
        (-0.02, {"returns": "strongest"}, [SCREEN]),
        (0.0, {"returns": "strongest", "near": "dark"}, [WALL]),
        (0.02, {"returns": "strongest", "far": "dark"}, [SCREEN]),
        # Only one thing in the beam.
        (1.0, {"returns": "dual"}, [WALL]),
        (-1.0, {"returns": "dual"}, [SCREEN]),
        (-1.0, {"returns": "last"}, [SCREEN]),
        # Half the length of a pulse is 2.85 m in 19 ns, 3.15 m in 21 ns, 4.5 m in 30 ns.
        (0.0, {"returns": "dual", "pulse_length_ns": 19.0}, [WALL, SCREEN]),
        (0.0, {"returns": "dual", "pulse_length_ns": 21.0}, [(11.12, 1)]),
        (0.0, {"returns": "dual", "pulse_length_ns": 30.0}, [(11.12, 1)]),
    ],
)
def test_what_is_reported_of_a_beam_on_an_edge(
    covered_m: float, fields: dict[str, Any], expected: list[tuple[float, int]]
) -> None:
    # The mean by power of 10 m and 13 m with equal shares: (1/10 + 1/13) / (1/100 + 1/169).
    assert reported(half_covered(covered_m, **fields)) == expected


def test_of_the_last_that_is_the_strongest_the_second_strongest_is_reported() -> None:
    rows = [
        targets.box("dark", (10.0, 5.02, 0), (0.1, 10, 10), "weak"),
        targets.box("gray", (15.0, 5.0, 0), (0.1, 10, 10), "middle"),
        targets.wall("white", 20.0, "last"),
    ]
    # 4 rays of 0.1 / 100, 4 of 0.5 / 225, 8 of 1 / 400.
    seen = targets.returns(*rows, **AXIS, **WIDE, returns="dual")
    assert [label for _, label in reported(seen)] == [3, 2]
    seen = targets.returns(*rows, **AXIS, **WIDE, returns="strongest")
    assert [label for _, label in reported(seen)] == [3]


def test_ranges_and_shares_of_the_parts() -> None:
    seen = half_covered(0.02, returns="dual", near="white", far="white")
    assert seen.range_m[:, 0, 0] == pytest.approx([FAR_M, NEAR_M], abs=2e-4)
    # 12 of 16 rays and 4 of them.
    assert seen.intensity[:, 0, 0].tolist() == [75, 25]


def test_a_slanted_surface_is_one_return_at_its_mean() -> None:
    floor = targets.box("gray", (0, 0, -2.5), (900, 900, 1), "floor")
    steep = {"elevations_deg": [-30.0], "returns": "dual", **AXIS, **WIDE}
    seen = targets.returns(floor, **steep)
    assert len(reported(seen)) == 1
    assert seen.range_m[0, 0, 0] == pytest.approx(4.0, abs=1e-3)
    # At 1.2 degrees the beam covers 40 m of it, but no gap in there is longer than 4.5 m.
    flat = {**steep, "elevations_deg": [-1.2], "max_range_m": 500.0, "pulse_length_ns": 100.0}
    assert len(reported(targets.returns(floor, **flat))) == 1


def test_a_beam_of_many_rays_on_a_flat_wall_is_one_ray() -> None:
    wall = targets.wall("gray", 20.0)
    lasers = {"elevations_deg": [-2.0, 0.0, 2.0]}
    plain = targets.returns(wall, **lasers)
    wide = targets.returns(wall, **lasers, divergence_mrad=[3.0, 1.5], rays_per_beam=64)
    np.testing.assert_allclose(wide.range_m, plain.range_m, atol=1e-3)
    np.testing.assert_array_equal(wide.label, plain.label)
    assert np.abs(wide.intensity - plain.intensity).max() <= 1


@pytest.mark.parametrize(("divergence", "edge"), [([20.0, 1.0], "y"), ([1.0, 20.0], "z")])
def test_divergence_is_the_full_angle_across_and_upward(divergence: list[float], edge: str) -> None:
    """Of the rays at 10 m the outermost are at 3 / 8 of 20 cm from the axis."""

    def covers(offset_m: float) -> bool:
        at = (NEAR_M + 0.05, *((5 + offset_m, 0) if edge == "y" else (0, 5 + offset_m)))
        screen = targets.box("gray", at, (0.1, 10, 10), "screen")
        spec = {**AXIS, "divergence_mrad": divergence, "rays_per_beam": 16, "returns": "dual"}
        return len(reported(targets.returns(screen, targets.wall("gray", FAR_M), **spec))) == 2

    assert [covers(x) for x in (-0.076, -0.074, 0.0, 0.074, 0.076)] == [False, *[True] * 3, False]


def test_what_is_nearer_than_the_least_range_hides_only_its_part_of_a_beam() -> None:
    seen = half_covered(0.0, returns="strongest", min_range_m=11.0)
    assert reported(seen) == [WALL]
    assert reported(half_covered(-1.0, returns="strongest", min_range_m=11.0)) == []


def test_rays_of_a_wide_beam_go_straight_in_their_directions() -> None:
    wide = {"divergence_mrad": [400.0, 200.0], "rays_per_beam": 16}
    seen = targets.returns(targets.wall("gray", 10.0), **AXIS, **wide)
    cells = np.array([-0.375, -0.125, 0.125, 0.375])
    across, upward = np.meshgrid(np.tan(0.4) * cells, np.tan(0.2) * cells)
    ranges = 10 * np.sqrt(1 + across**2 + upward**2)
    power = (10 / ranges) / ranges**2
    assert seen.range_m.item() == pytest.approx((ranges * power).sum() / power.sum(), abs=1e-5)
    assert seen.intensity.item() == round(float(np.mean(50 * 10 / ranges)))


def test_beams_meet_other_vehicles_as_they_stand_at_each_instant() -> None:
    """Beams of hardly any width see what rays do, of a vehicle that passes at 15 m/s."""

    def passing(t: float) -> tuple[Any, Any]:
        return (-1.5 + 15.0 * t, 1.5, 0.8), (0.0, 0.0, 5.0 * t)

    hull = {"name": "hull", "shape": {"kind": "box", "size_m": [0.8, 0.5, 1.2]}, "material": "dark"}

    def seen(**lidar: Any) -> Returns:
        above = {"xyz_m": [0.0, 0.0, 0.4]}
        made = rooms.scenario(others=[hull], mount=above, **lidar)
        return rooms.scans(made, rooms.at_rest, 41, others=[passing])[0].returns

    plain, beams = seen(), seen(divergence_mrad=[1e-3, 1e-3], rays_per_beam=4)
    assert np.count_nonzero(plain.body >= 0) > 50
    same = plain.body == beams.body
    assert same.mean() > 0.999  # all but at edges
    np.testing.assert_allclose(beams.range_m[same], plain.range_m[same], atol=1e-3)


EVERYTHING: dict[str, Any] = {
    **{"divergence_mrad": [30.0, 15.0], "rays_per_beam": 16, "returns": "dual"},
    **{"azimuth_stddev_deg": 0.05, "elevation_stddev_deg": 0.05, "dropout": 0.05},
    **{"range_stddev_m": 0.02, "range_stddev_share": 0.001, "laser_bias_m": 0.02},
    **{"full_range_reflectivity": 0.1, "pulse_length_ns": 2.0},
}
PILLARS = [
    {
        "name": f"pillar{i}",
        "shape": {"kind": "cylinder", "radius_m": 0.1, "length_m": 3.0},
        "material": "z",
        "position_m": [3 * math.cos(i), 3 * math.sin(i), 1.5],
    }
    for i in range(6)
]


def test_blocks_hold_the_very_numbers_of_the_revolution() -> None:
    way = rooms.driving(speed_mps=2.0, turn_radps=1.0)
    whole = rooms.clouds(rooms.scenario(solids=PILLARS, **EVERYTHING), way, 81)
    for block_deg in (90.0, 1.0):
        blocks = rooms.clouds(
            rooms.scenario(solids=PILLARS, **EVERYTHING, block_deg=block_deg), way, 81
        )
        count = round(360 / block_deg)
        for i, cloud in enumerate(whole):
            own = np.concatenate([b.records() for b in blocks[count * i : count * (i + 1)]])
            for field in ("x", "y", "z", "intensity", "ring"):
                assert own[field].tobytes() == cloud.records()[field].tobytes(), field


def test_a_cloud_has_both_returns_of_a_ray() -> None:
    made = rooms.scenario(solids=PILLARS, **{**EVERYTHING, "dropout": 0.0})
    clouds = rooms.clouds(made, rooms.at_rest, 41)
    (scan,) = rooms.scans(made, rooms.at_rest, 41)
    twice = scan.returns.returned.all(axis=0)
    assert 50 < np.count_nonzero(twice) < 1000
    records = clouds[0].records()
    assert len(records) == np.count_nonzero(scan.returns.returned)
    # One after the other, and of the same instant and laser.
    pairs = np.flatnonzero((np.diff(records["time"]) == 0) & (np.diff(records["ring"]) == 0))
    assert len(pairs) == np.count_nonzero(twice)
    last, strongest = (np.linalg.norm(rooms.points(clouds[0])[pairs + i], axis=1) for i in (0, 1))
    order = twice.T  # firing after firing
    for which, ranges in enumerate((last, strongest)):
        expected = scan.returns.range_m[which].T[order]
        np.testing.assert_allclose(ranges, expected, rtol=1e-5)
