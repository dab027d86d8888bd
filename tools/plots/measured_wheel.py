# SPDX-License-Identifier: Apache-2.0
"""Single wheel in sand as it was measured, with the soil that was fitted to it.

Source: data of Pavlov and Johnson (Carnegie Mellon University), published with A Terramechanics
Model for High Slip Angle and Skid with Prediction of Wheel-Soil Interaction Geometry (2022), in
the public repository robomechanics/3d-terramechanics: the smooth wheel, driven straight ahead at
10 mm/s, three trials at each slip. Figures here are means over the trials.
"""

from typing import NamedTuple

from groundlink.world.solids import Soil

RADIUS_M, WIDTH_M = 0.058, 0.05


class WheelMeasurement(NamedTuple):
    """Steady state of the wheel at a slip."""

    slip: float
    load_n: float
    drawbar_n: float
    scatter_n: float
    """Standard deviation of the drawbar pull within a trial."""

    sinkage_m: float


MEASURED = (
    WheelMeasurement(-0.70, 21.84, -24.13, 2.15, 0.0324),
    WheelMeasurement(-0.50, 23.24, -17.15, 1.31, 0.0237),
    WheelMeasurement(-0.20, 23.72, -7.31, 0.96, 0.0151),
    WheelMeasurement(0.00, 24.58, -1.34, 0.77, 0.0144),
    WheelMeasurement(0.23, 24.62, 0.70, 1.21, 0.0179),
    WheelMeasurement(0.50, 25.28, 0.97, 2.70, 0.0227),
    WheelMeasurement(0.75, 24.00, 0.82, 2.78, 0.0254),
)

SAND = Soil(
    k_c=0.0,
    k_phi=9.8e5,
    n=1.0,
    cohesion_pa=0.0,
    friction_angle_deg=29.0,
    shear_displacement_m=0.0177,
    density_kgpm3=1330.0,
    unloading_npm3=4.2e6,
    stress_angle=0.19,
    stress_angle_by_slip=0.39,
    slip_sinkage=0.41,
)
"""The authors' density and angle of repose. All else is fitted to the rows of a slip from -0.5
on, so that the row of -0.7 is a prediction."""
