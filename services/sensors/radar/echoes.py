# SPDX-License-Identifier: Apache-2.0
"""Echoes of surfaces at 77 GHz: radar cross-section of a patch, radar equation, rain.

A patch of a surface returns a share of the power by its reflectivity at normal incidence (Fresnel).
Most of it is in a lobe around the mirror's direction, by geometric optics for a rough surface
(Barrick 1968; Ulaby and Long 2014, "Microwave Radar and Radiometric Remote Sensing", 10-4):

    sigma0 = R / (2 s^2 cos^4 t) exp(-tan^2 t / (2 s^2))

with the incidence angle t, the reflectivity R and the slope s. A share S^2 scatters evenly instead,
by Lambert's law: sigma0 = 4 R S^2 cos^2 t, S = 0.4 (Degli-Esposti et al. 2007, "Measurement and
modelling of scattering from buildings", IEEE Trans. Antennas Propag. 55). A sphere of radius a
has about R pi a^2, as it should.

Rain attenuates by k r^alpha dB/km at r mm/h, ITU-R P.838-3 at 77 GHz, horizontal polarization. Fog
and dust are left out: fog of 50 m visibility (0.5 g/m^3) takes 1 to 2 dB/km, ITU-R P.840.
"""

from typing import NamedTuple

import numpy as np

from groundlink.core.frames import Floats

SLOPE = 0.1
"""Root mean square slope of surfaces: roughness, and curvature below the size of triangles. An
estimate."""

SCATTERED = 0.4**2
"""Share S^2 of the reflected power that scatters evenly."""

RAIN_K, RAIN_ALPHA = 1.1320, 0.7177
"""Coefficients of ITU-R P.838-3 at 77 GHz."""


def reflectivity(permittivity: complex) -> float:
    """Return the power reflectivity of a half-space at normal incidence (Fresnel)."""
    index = complex(permittivity) ** 0.5
    return float(abs((index - 1) / (index + 1)) ** 2)


PERMITTIVITIES: dict[str, complex] = {
    # ITU-R P.2040-3, table 3. Of brick and dry ground up to 40 and 10 GHz only; rock as marble.
    "concrete": 5.24,
    "brick": 3.91,
    "plaster": 2.73,
    "wood": 1.99,
    "glass": 6.31,
    "rock": 7.07,
    "soil": 3.0,
    "sand": 3.0,
    # Ice and water at 20 C (double Debye model): ITU-R P.527 and P.840.
    "ice": 3.15,
    "water": 8.8 - 15.9j,
    # Skin: Gabriel et al. 1996, "The dielectric properties of biological tissues". Clothes are
    # nearly transparent; the body is behind them.
    **dict.fromkeys(("skin", "cloth", "denim"), 6.6 - 8.9j),
}
"""Relative permittivity at 77 GHz by name of material."""

METALS = (
    *("metal", "dark_metal", "sheet_metal", "aluminum", "steel", "car_paint"),
    *("rear_reflector", "number_plate", "reflective_tape"),
)
"""Materials that are metal, or a thin layer on metal."""

REFLECTIVITIES = {name: reflectivity(value) for name, value in PERMITTIVITIES.items()} | (
    dict.fromkeys(METALS, 1.0)
)
"""Power reflectivity at normal incidence by name of material."""

OTHER_REFLECTIVITY = 0.1
"""Reflectivity of all other materials: permittivity 3.7, that of plastics, plants and asphalt
roughly. An estimate."""


def cross_sections(
    range_m: Floats, cosine: Floats, reflectivity: Floats, solid_angle_sr: Floats
) -> Floats:
    """Return the radar cross-section of the patches that rays stand for, in m^2.

    Parameters
    ----------
    range_m : shape (N,)
    cosine
        Of the incidence angle, 0..1.
    reflectivity
        Power reflectivity at normal incidence.
    solid_angle_sr
        Solid angle of each ray.
    """
    cosine = np.maximum(cosine, 1e-3)
    squared_tangent = 1 / cosine**2 - 1
    lobe = np.exp(-squared_tangent / (2 * SLOPE**2)) / (2 * SLOPE**2 * cosine**4)
    sigma0 = reflectivity * ((1 - SCATTERED) * lobe + SCATTERED * 4 * cosine**2)
    area_m2 = range_m**2 * solid_angle_sr / cosine
    return sigma0 * area_m2


def rain_db_per_km(rain_mm_per_h: float) -> float:
    """Return the attenuation by rain, one way."""
    return float(RAIN_K * rain_mm_per_h**RAIN_ALPHA)


class RadarEquation(NamedTuple):
    """Signal-to-noise ratio of an echo: unit_snr * rcs / range^4, less what rain takes."""

    unit_snr: float
    """SNR of 1 m^2 at 1 m in clear air, as a ratio."""

    loss_db_per_km: float = 0.0
    """Attenuation of the air, one way."""

    def snr(self, rcs_m2: Floats, range_m: Floats) -> Floats:
        """Return the SNR of echoes, as a ratio."""
        loss_db = 2 * self.loss_db_per_km * range_m / 1000
        return self.unit_snr * rcs_m2 / range_m**4 * 10 ** (-loss_db / 10)

    def rcs(self, snr: Floats, range_m: Floats) -> Floats:
        """Return the cross-sections that a device computes, which knows of no rain, in m^2."""
        return snr * range_m**4 / self.unit_snr
