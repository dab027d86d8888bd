# SPDX-License-Identifier: Apache-2.0
"""Radar cross-sections, rain and the radar equation against closed forms."""

import math

import numpy as np
import pytest

from services.sensors.radar.echoes import (
    REFLECTIVITIES,
    SCATTERED,
    SLOPE,
    RadarEquation,
    cross_sections,
    rain_db_per_km,
    reflectivity,
)

A, B, C = (
    (-5.33980, -0.35351, -0.23789, -0.94158),
    (-0.10008, 1.26970, 0.86036, 0.64552),
    (
        *(1.13098, 0.45400),
        *(0.15354, 0.16817),
    ),
)
"""Coefficients of ITU-R P.838-3, table 1."""
D, E, F = (
    (-0.14318, 0.29591, 0.32177, -5.37610, 16.1721),
    (1.82442, 0.77564, 0.63773, -0.96230, -3.29980),
    (-0.55187, 0.19822, 0.13164, 1.47828, 3.43990),
)
"""The same, table 3."""


def bells(a: tuple[float, ...], b: tuple[float, ...], c: tuple[float, ...]) -> float:
    at = math.log10(77)
    return sum(x * math.exp(-(((at - y) / z) ** 2)) for x, y, z in zip(a, b, c, strict=True))


def test_rain_attenuates_as_p_838_says() -> None:
    k = 10 ** (bells(A, B, C) - 0.18961 * math.log10(77) + 0.71147)
    alpha = bells(D, E, F) + 0.67849 * math.log10(77) - 1.95537
    for rate in (1.0, 10.0, 50.0):
        assert rain_db_per_km(rate) == pytest.approx(k * rate**alpha, rel=1e-3)
    assert rain_db_per_km(0.0) == 0


def test_a_sphere_has_the_cross_section_of_geometric_optics() -> None:
    """pi a^2 R from the lobe, which is wider by the slope squared; 8/3 pi a^2 R scattered."""
    radius_m, distance_m, share = 0.5, 100.0, 0.3
    # Rays in even rings of their offset from the axis, nearly parallel.
    offset_m = (np.arange(4000) + 0.5) / 4000 * radius_m
    cosine = np.sqrt(1 - (offset_m / radius_m) ** 2)
    solid_angle_sr = 2 * math.pi * offset_m * (radius_m / 4000) / distance_m**2
    far_m, all_alike = np.full(4000, distance_m), np.full(4000, share)
    found = cross_sections(far_m, cosine, all_alike, solid_angle_sr).sum()
    lobe = (1 - SCATTERED) * (1 + SLOPE**2)
    expected = math.pi * radius_m**2 * share * (lobe + SCATTERED * 8 / 3)
    assert found == pytest.approx(expected, rel=2e-3)


def test_metal_reflects_all_and_concrete_a_seventh() -> None:
    assert REFLECTIVITIES["metal"] == 1.0
    assert REFLECTIVITIES["concrete"] == pytest.approx(0.154, abs=0.001)
    assert reflectivity(1.0) == 0.0
    # A person: about a sphere with the area of a body from the front, -8 dBsm as measured.
    assert 10 * math.log10(REFLECTIVITIES["skin"] * 0.5) == pytest.approx(-8, abs=1)


def test_the_radar_equation_and_its_inverse() -> None:
    range_m, rcs_m2 = np.array([10.0, 20.0, 40.0]), np.array([1.0, 1.0, 16.0])
    clear, wet = RadarEquation(1e6), RadarEquation(1e6, 10.0)
    snr = clear.snr(rcs_m2, range_m)
    np.testing.assert_allclose(snr / snr[0], [1, 1 / 16, 1 / 16])
    np.testing.assert_allclose(clear.rcs(snr, range_m), rcs_m2)
    loss_db = 10 * np.log10(snr / wet.snr(rcs_m2, range_m))
    np.testing.assert_allclose(loss_db, [0.2, 0.4, 0.8])
