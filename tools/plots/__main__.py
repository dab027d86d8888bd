# SPDX-License-Identifier: Apache-2.0
"""Write the plots of docs/explanation: ``python -m tools.plots [NAME ...]``.

Without names all plots are written, in half a minute of processor time. Dots are results of the
models; lines are the formulas beside which the documents show the plots.
"""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from . import cameras, inertial, ranging, satellites, soils, vehicles, wheels
from .page_style import save, styled

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "pictures" / "models"

FIGURES: dict[str, Callable[[], Figure]] = {
    "camera_noise": cameras.noise,
    "camera_shutter": cameras.shutter,
    "depth_noise": cameras.depth_noise,
    "encoders": wheels.encoders,
    "gnss_error": inertial.gnss_error,
    "gnss_sky": satellites.gnss_sky,
    "imu_allan": inertial.imu_allan,
    "imu_filter": inertial.imu_filter,
    "lidar_light": ranging.lidar_light,
    "lidar_range": ranging.lidar_range,
    "lidar_sun": ranging.lidar_sun,
    "lidar_weather": ranging.lidar_weather,
    "range_finder": ranging.range_finder,
    "soil_measured": soils.measured,
    "soil_slopes": soils.slopes,
    "soil_tire": soils.tire,
    "soil_track": soils.track,
    "soil_wheel": soils.wheel,
    "vehicle_motor": vehicles.motor,
    "vehicle_skid": vehicles.skid,
    "vehicle_steering": vehicles.steering,
    "vehicle_tire": vehicles.tire,
}
"""Figures by the name of their file."""


def main(arguments: Sequence[str]) -> None:
    """Write the named plots, or all."""
    parser = argparse.ArgumentParser(prog="python -m tools.plots", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(FIGURES))
    names = parser.parse_args(arguments).names
    if unknown := set(names) - FIGURES.keys():
        parser.error(f"no plot {', '.join(sorted(unknown))}; expected {', '.join(FIGURES)}")
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in names or FIGURES:
        file = FOLDER / f"{name}.svg"
        with styled():
            save(FIGURES[name](), file)
        print(f"wrote {file}: {file.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
