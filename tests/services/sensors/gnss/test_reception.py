# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from groundlink.core.errors import UserError
from services.sensors.gnss.dilution import geometry
from services.sensors.gnss.sky import directions, open_sky
from tests.services.sensors.gnss.test_model import UP, fixes, receiver
from tests.services.sensors.yards import box, resting, yard


@pytest.mark.parametrize(
    ("azimuth_deg", "elevation_deg", "expected"),
    [(0, 0, (0, 1, 0)), (90, 0, (1, 0, 0)), (180, 0, (0, -1, 0)), (123, 90, (0, 0, 1))],
)
def test_azimuth_is_clockwise_from_north(
    azimuth_deg: float, elevation_deg: float, expected: tuple[float, float, float]
) -> None:
    (found,) = directions([(azimuth_deg, elevation_deg)]).T
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize("elevation_deg", [5.0, 30.0, 60.0])
def test_dilution_of_one_overhead_and_three_around(elevation_deg: float) -> None:
    """With s = sin(elevation): HDOP^2 = 4 / (3 (1 - s^2)) and VDOP^2 = 4 / (3 (1 - s)^2)."""
    towards = directions([(0, 90), *((azimuth, elevation_deg) for azimuth in (0, 120, 240))])
    found = open_sky(towards)
    sine = math.sin(math.radians(elevation_deg))
    assert found.satellites == 4
    assert found.horizontal_dilution == pytest.approx(math.sqrt(4 / (3 * (1 - sine**2))))
    assert found.dilution_enu[0] == pytest.approx(found.dilution_enu[1])
    assert found.dilution_enu[2] == pytest.approx(math.sqrt(4 / 3) / (1 - sine))


def test_too_few_or_all_at_one_height_give_no_position() -> None:
    ring = directions([(azimuth, 40) for azimuth in range(0, 360, 60)])
    with pytest.raises(UserError, match="spread them over the sky"):
        open_sky(ring)
    spread = directions([(0, 90), (0, 30), (120, 30), (240, 30)])
    visible = np.array([True, True, True, False])
    assert geometry(spread, visible) is None


@pytest.mark.parametrize(("side", "x_m", "seen"), [("west", -2.0, 1), ("east", 2.0, 0)])
def test_wall_hides_objects_behind(side: str, x_m: float, seen: int) -> None:
    """A low satellite in the east, beside five that no wall of this height hides."""
    satellites = (
        (90.0, 20.0),
        (0.0, 80.0),
        (60.0, 75.0),
        (130.0, 79.0),
        (200.0, 76.0),
        (270.0, 85.0),
    )
    made = yard(box("wall", (0.2, 50, 10), (x_m, 0, 0)))
    model = receiver(made, mount=UP, sky_view=True, satellites_deg=satellites)
    (fix,) = fixes(model, resting(1))
    gga = model.datagrams(fix, 0)[0].payload.decode().split(",")
    assert int(gga[7]) == 5 + seen
