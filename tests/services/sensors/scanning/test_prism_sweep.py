# SPDX-License-Identifier: Apache-2.0
"""The Avia's pattern: beside the manufacturer's table, by Snell's law, and over time."""

from typing import Any

import msgspec
import numpy as np
import pytest

from groundlink.scenario.rotating_lidar import TurningPrisms
from services.sensors.lidar.spec import Lidar
from services.sensors.scanning.prism_sweep import PrismSweep
from tests.services.sensors.lidar.native.test_vlp16 import sheet
from tests.services.sensors.sheets import from_sheet

from .moving_patterns import check_blocks_of_a_drive

# Azimuth and elevation of the first and the last line by row, of the table avia.csv in
# Livox-SDK/livox_laser_simulation, by the copy in mujoco-lidar 0.3.5 (MIT). Six of its lines, those
# of 25 us, are a row here.
TABLE_DEG = {
    0: ((-35.271, 2.243), (-35.271, -2.243)),
    17: ((-33.746, -0.915), (-33.852, -5.382)),
    4001: ((-23.075, -2.267), (-23.056, -6.659)),
    40123: ((-31.370, -1.490), (-31.853, -6.070)),
    80999: ((26.890, -20.157), (28.553, -25.436)),
    120345: ((-3.358, 1.869), (-3.404, -2.632)),
    159999: ((-9.745, 2.571), (-9.612, -1.931)),
}


@pytest.fixture(scope="module")
def sweep() -> PrismSweep:
    spec = from_sheet(Lidar, "avia")
    assert spec.prisms is not None
    return PrismSweep(spec, spec.prisms)


def angles_deg(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return azimuth and elevation of directions, shape (3, ...)."""
    x, y, z = directions.astype(np.float64)
    return np.degrees(np.arctan2(y, x)), np.degrees(np.arcsin(z))


def test_directions_are_those_of_the_table(sweep: PrismSweep) -> None:
    for row, expected_deg in TABLE_DEG.items():
        found = angles_deg(sweep.directions(np.full((6, 1), row * 25e-6)))
        ends = np.stack(found, axis=-1)[[0, 5], 0]
        np.testing.assert_allclose(ends, expected_deg, atol=2e-3)


def test_lines_fire_one_after_the_other(sweep: PrismSweep) -> None:
    """A line of a revolution is where the table has it at that line's own instant."""
    sweep.aim(10)
    expected = sweep.directions(1.0 + sweep.seconds)
    assert sweep.seconds[5, 0] == pytest.approx(5 / 240_000, abs=1e-9)
    np.testing.assert_allclose(sweep.directions_in_sensor, expected, atol=1e-6)


def test_faces_bend_by_snells_law() -> None:
    """One beam through wedges that stand still, in the plane of both normals, by angles alone."""
    fields = {"name": "it", "topic": "/it", "frame": "it_link", "elevations_deg": [0.0]}
    spec = msgspec.convert(fields, Lidar)
    prisms = TurningPrisms(turns_per_s=(0.0, 0.0), wedge_deg=12.0, refractive_index=1.5)
    wedge = np.radians(12.0)
    inside = wedge - np.arcsin(np.sin(wedge) / 1.5)
    bent_deg = np.degrees(np.arcsin(1.5 * np.sin(inside + wedge)) - wedge)
    azimuth_deg, elevation_deg = angles_deg(PrismSweep(spec, prisms).directions_in_sensor)
    assert azimuth_deg == pytest.approx(-bent_deg, abs=1e-5)
    assert elevation_deg == pytest.approx(0, abs=1e-5)
    # Half a turn of the second wedge later, both bend to opposite sides.
    opposite = TurningPrisms(turns_per_s=(0.0, 0.5), wedge_deg=12.0, refractive_index=1.5)
    directions = PrismSweep(spec, opposite).directions(np.ones((1, 1)))
    assert abs(angles_deg(directions)[0]) < 0.5


def test_the_view_is_that_of_the_specification(sweep: PrismSweep) -> None:
    seen = []
    for revolution in range(5):
        sweep.aim(revolution)
        seen.append(np.stack(angles_deg(sweep.directions_in_sensor)).reshape(2, -1))
        lengths = np.linalg.norm(sweep.directions_in_sensor, axis=0)
        assert lengths == pytest.approx(1, abs=1e-6)
    most = np.abs(np.concatenate(seen, axis=1)).max(axis=1)
    assert 2 * most == pytest.approx((70.4, 77.2), abs=0.3)


def test_the_pattern_does_not_repeat_itself(sweep: PrismSweep) -> None:
    """The share of cells of half a degree that have been hit grows from message to message."""
    hit = np.zeros((128, 128), bool)
    row, column = np.indices(hit.shape) / 2 - 31.75
    disc = np.hypot(row, column) < 32
    shares = []
    for revolution in range(20):
        sweep.aim(revolution)
        azimuth_deg, elevation_deg = angles_deg(sweep.directions_in_sensor)
        cells = np.floor(2 * np.stack([elevation_deg, azimuth_deg])).astype(int) + 64
        near = (cells >= 0).all(axis=0) & (cells < 128).all(axis=0)
        hit[tuple(cells[:, near])] = True
        shares.append(hit[disc].mean())
    assert shares[0] < 0.75
    assert np.all(np.diff(shares[:4]) > 0.02)
    assert shares[-1] > 0.99


def test_points_of_blocks_and_messages_are_on_the_walls() -> None:
    exact = {"azimuth_stddev_deg": 0.0, "elevation_stddev_deg": 0.0, "range_stddev_m": 0.0}
    fields = sheet("avia", **exact, range_resolution_m=0.0, sun=None)
    check_blocks_of_a_drive(fields)


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"mirror": sheet("mid360")["mirror"]}, "`mirror` and `prisms` are both set"),
        ({"mixed_pixels": True}, "need a turning head"),
        ({"blooming": {"share": 0.1, "width_mrad": 1.0}}, "need a turning head"),
        (
            {"prisms": {"turns_per_s": [1.0, 2.0], "wedge_deg": 30.0, "refractive_index": 1.8}},
            "no beam leaves wedges of 30 degrees and refractive index 1.8",
        ),
    ],
)
def test_contradictions_are_refused(changed: dict[str, Any], reason: str) -> None:
    own = {"name": "it", "topic": "/it", "frame": "it_link"}
    with pytest.raises(msgspec.ValidationError, match=reason):
        msgspec.convert({**sheet("avia"), **own, **changed}, Lidar)
