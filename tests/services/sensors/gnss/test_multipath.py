# SPDX-License-Identifier: Apache-2.0
"""Reflections by walls and the errors that they cause, against known answers."""

import math
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from groundlink.messages.base import State
from groundlink.scenario.schema import Scenario
from groundlink.world.solids import Solid
from services.sensors.gnss.multipath import (
    CHIP_M,
    WAVELENGTH_M,
    carrier_errors_m,
    code_errors_m,
    detours_m,
)
from services.sensors.gnss.reception import SKY_M, Path
from services.sensors.gnss.sky import directions
from services.sensors.gnss.spec import Multipath, Solution
from services.sensors.rays.probe import RayProbe
from tests.services.sensors.gnss.test_model import UP, enu_m, fixes, receiver
from tests.services.sensors.yards import box, moving, resting, yard

WALL = box("wall", (60, 0.2, 30), (0, 5.1, 14))
"""Its face is at y = 5, from 1 m below the ground to 29 m above."""

SATELLITES = ((180.0, 30.0), (180.0, 75.0), (0.0, 30.0), (90.0, 40.0), (225.0, 20.0), (270.0, 60.0))
"""South low and high, north behind the wall, along the wall, south-west, along the wall."""


def detours(
    *solids: Solid, antenna: tuple[float, float, float] = (0, 0, 1), reach_m: float = 50
) -> Any:
    made = yard(*solids)
    probe = RayProbe(made, made.vehicles[0], UP)
    (state,) = resting(1, (0, 0, -100))
    probe.take(state)
    towards = directions(SATELLITES)
    cast = partial(probe.cast, 0)
    return detours_m(
        np.array(antenna, np.float64), towards, Multipath(reach_m=reach_m), SKY_M, cast
    )


def test_a_wall_lengthens_the_path_by_twice_the_distance_times_the_cosine() -> None:
    """The image of an antenna h before a wall: 2 h (s . n), with n the wall's normal."""
    found = detours(WALL)
    low, high, skew = (
        2 * 5 * math.cos(math.radians(elevation)) * math.cos(math.radians(off))
        for elevation, off in ((30, 0), (75, 0), (20, 45))
    )
    np.testing.assert_allclose(found, (low, high, np.inf, np.inf, skew, np.inf), atol=2e-5)
    # From 2 m nearer, all detours are shorter by 2 h' / h.
    np.testing.assert_allclose(
        detours(WALL, antenna=(0, 2, 1))[[0, 1, 4]], np.array([low, high, skew]) * 3 / 5, atol=2e-5
    )


@pytest.mark.parametrize(
    ("others", "seen"),
    [
        # The high satellite's point of reflection is 18.7 m above the antenna.
        pytest.param((box("wall", (60, 0.2, 16), (0, 5.1, 7)),), [0, 4], id="a lower wall"),
        # 5 m to the west, beyond the end of the wall, and 5 m north.
        pytest.param((box("wall", (8, 0.2, 30), (0, 5.1, 14)),), [0, 1], id="a shorter wall"),
        # Between the wall and the antenna, just over the low satellite's direct path.
        pytest.param(
            (WALL, box("beam", (0.5, 0.5, 0.5), (0, 2.5, 1 + 7.5 * math.tan(math.radians(30))))),
            [1, 4],
            id="a beam before the wall",
        ),
        pytest.param((box("pole", (0.3, 0.3, 30), (0, 5.1, 14)),), [], id="a pole"),
        pytest.param((box("ceiling", (60, 60, 0.2), (0, 0, 5)),), [], id="a ceiling"),
    ],
)
def test_only_walls_that_extend_to_the_point_of_reflection_reflect(
    others: tuple[Solid, ...], seen: list[int]
) -> None:
    assert np.flatnonzero(np.isfinite(detours(*others))).tolist() == seen


def test_far_walls_do_not_reflect() -> None:
    assert not np.isfinite(detours(WALL, reach_m=4.9)).any()


@pytest.mark.parametrize("amplitude", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("chips", [0.1, 1.0])
def test_code_errors_are_the_zeros_of_the_discriminator(amplitude: float, chips: float) -> None:
    spec = Multipath(amplitude=amplitude, correlator_chips=chips)

    def correlation(shift: float) -> float:
        return max(0.0, 1 - abs(shift))

    for detour in (0.3, 2.07, 8.4, 40.02, 150.05, 260.0, 300.01, 450.0):
        phasor = amplitude * math.cos(2 * math.pi * detour / WAVELENGTH_M)

        def early_minus_late(shift: float, phasor: float = phasor, detour: float = detour) -> float:
            late, early = (
                correlation(shift + off) + phasor * correlation(shift + off - detour / CHIP_M)
                for off in (chips / 2, -chips / 2)
            )
            return early - late

        zero = brentq(early_minus_late, -chips / 2 - 1e-9, chips / 2 + 1e-9, xtol=1e-14)
        (found,) = code_errors_m(np.array([detour]), spec)
        assert found == pytest.approx(CHIP_M * zero, abs=1e-8)


def test_carrier_errors_are_the_phase_of_the_sum_and_less_than_a_quarter_of_the_wave() -> None:
    spec = Multipath(amplitude=0.5)
    eighth = WAVELENGTH_M * np.array([0.0, 0.25, 0.5, 0.75, 40.25])
    expected = WAVELENGTH_M / (2 * math.pi) * math.atan2(0.5, 1.0)
    np.testing.assert_allclose(
        carrier_errors_m(eighth, spec), (0, expected, 0, -expected, expected), atol=1e-9
    )
    many = carrier_errors_m(np.linspace(0, 10, 5000), Multipath(amplitude=0.99))
    most = WAVELENGTH_M / (2 * math.pi) * math.asin(0.99)
    assert np.abs(many).max() == pytest.approx(most, rel=1e-3)
    assert most < WAVELENGTH_M / 4


def canyon(**fields: Any) -> tuple[Scenario, dict[str, Any]]:
    return yard(WALL), {
        **{"mount": UP, "sky_view": True, "satellites_deg": SATELLITES},
        **{"multipath": Multipath(amplitude=0.5), "rate_hz": 20},
        **fields,
    }


def along(speed_mps: float, ticks: int) -> list[State]:
    """Return states of a vehicle that drives towards the wall, so that detours shorten."""
    y = np.arange(ticks) / 400 * speed_mps
    return list(moving(np.stack([0 * y, y, 0 * y], axis=1)))


def test_the_error_stands_with_the_vehicle_and_changes_as_it_drives() -> None:
    made, fields = canyon()
    standing = enu_m(fixes(receiver(made, **fields), resting(400)))
    assert np.ptp(standing, axis=0).max() < 1e-6
    assert np.linalg.norm(standing[0] - UP.xyz_m) > 0.1
    states = along(0.5, 800)
    driving = enu_m(fixes(receiver(made, **fields), states))
    truth = np.array([state.vehicles["rover"].poses()[0, :3] for state in states[::20]])
    errors = driving - truth - UP.xyz_m
    assert np.ptp(errors, axis=0).max() > 1.0
    assert np.abs(errors).max() < 30
    again = enu_m(fixes(receiver(made, **fields), states))
    assert (again == driving).all()


def test_carrier_solutions_are_shifted_by_centimeters() -> None:
    made, fields = canyon(solution="rtk_fix")
    taken = enu_m(fixes(receiver(made, **fields), resting(1)))
    assert 0.001 < np.linalg.norm(taken[0] - UP.xyz_m) < 0.2


def test_a_hidden_satellite_is_received_by_its_reflection_late_and_not_by_carrier() -> None:
    """A house in the south hides two satellites; their signals come from the wall, and later."""
    made = yard(WALL, box("house", (60, 3, 7), (0, -4, 0.5)))
    _, fields = canyon()
    (fix,) = fixes(model := receiver(made, **fields), resting(1))
    details = model.details(fix)
    assert details.signals.path.tolist() == [
        *(Path.REFLECTED, Path.DIRECT, Path.NONE, Path.DIRECT, Path.REFLECTED, Path.DIRECT),
    ]
    assert details.signals.detour_m[0] == pytest.approx(10 * math.cos(math.radians(30)), abs=1e-4)
    assert details.solved is not None
    assert details.solved.used.tolist() == [True, True, False, True, True, True]
    solutions = (Solution("single_point"), Solution("rtk_fix"))
    # Carriers have the three direct signals only.
    for solution, status in ((solutions[:1], 0), (solutions[1:], -1)):
        (fix,) = fixes(receiver(made, **fields, solutions=solution), resting(1))
        assert fix.status == status
