# SPDX-License-Identifier: Apache-2.0
"""A data sheet with the noise and dropout of a recording in place of the maker's figures."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from groundlink.core.errors import UserError
from groundlink.loader.datasheets import CheckedDatasheet

from .echo_statistics import (
    WINDOW,
    Bands,
    Windows,
    at_bands,
    dropout_bands,
    expected_noise,
    find_shots,
    find_windows,
    intensity_by_incidence,
    noise_bands,
    noise_by_incidence,
    quantization_m,
)
from .firings import Firings, Reals
from .recordings import read_firings
from .sheet_file import FittedSheet

REPLACED = ("range_stddev_m", "range_stddev_share", "laser_stddevs_m", "dropout", "echo_bands")
"""Fields of a sheet whose effects are in the fitted table."""

CORRECTIONS = 10
"""Rounds of correction of the table."""

MOST_CORRECTION = 2.0
"""Greatest factor between a knot of the table and the figure of its band."""

ROUGH = 3
"""Neighbors of a lost return that deviate by more than so many sigma are on no smooth surface."""


class EchoFit(NamedTuple):
    """What a recording says about a LiDAR."""

    windows: Windows
    noise: Bands
    """Standard deviation of ranges, in meters, with their rounding."""

    dropout: Bands
    step_m: float
    """Quantization of ranges; 0 for none."""

    firings: int


def fit(firings: Firings, source: str) -> EchoFit:
    """Return the statistics of a recording.

    Raises
    ------
    UserError
        when no band has enough data; `source` names the recording.
    """
    windows = find_windows(firings)
    noise = noise_bands(windows)
    if not noise.value.size:
        raise UserError(
            f"{source}: {len(windows.laser)} windows of smooth surfaces, too few in each band of "
            "intensity and range. Fix: record longer, or at walls and on level ground"
        )
    shots = find_shots(firings, ROUGH * float(np.nanmedian(noise.value)))
    return EchoFit(
        windows, noise, dropout_bands(shots), quantization_m(firings), len(firings.range_m)
    )


def echo_bands(found: EchoFit) -> dict[str, Any]:
    """Return the field `echo_bands` of a sheet.

    A sensor interpolates between the knots of the table, so the figures of the bands are not those
    of the knots: the table is corrected until the windows, with noise of it, give the recorded
    figures. Bands without data have the value of the nearest range with data in the same row, in
    between linear. Rounding is a field of its own; its variance, a twelfth of the step squared, is
    no noise.
    """
    noise = found.noise
    intensity, range_m = np.meshgrid(noise.intensity, noise.range_m, indexing="ij")
    lost = at_bands(found.dropout, intensity.ravel(), range_m.ravel()).reshape(intensity.shape)
    table = {
        "intensity": np.round(noise.intensity, 1).tolist(),
        "range_m": np.round(noise.range_m, 1).tolist(),
        "stddev_m": np.round(_corrected(found), 4).tolist(),
    }
    if np.nanmax(lost, initial=0) > 0:
        table["dropout"] = np.round(_filled(noise.range_m, lost), 4).tolist()
    return table


def _corrected(found: EchoFit) -> Reals:
    """Return the standard deviations at the knots, in meters, without rounding."""
    noise, windows, step = found.noise, found.windows, found.step_m
    rounding = step**2 / 12
    least = step / 10
    start = table = np.maximum(np.sqrt(np.maximum(noise.value**2 - rounding, 0)), least)
    places = windows.intensity.mean(axis=1), windows.curve_m[:, WINDOW // 2]
    knots = np.meshgrid(noise.intensity, noise.range_m, indexing="ij")
    for _ in range(CORRECTIONS):
        sigma = _interpolated(noise, _filled(noise.range_m, table), *places)
        got = expected_noise(windows, sigma**2 + rounding)
        now = at_bands(got, knots[0].ravel(), knots[1].ravel()).reshape(table.shape)
        table = np.clip(table * noise.value / now, start / MOST_CORRECTION, start * MOST_CORRECTION)
    return _filled(noise.range_m, np.maximum(table, least))


def _interpolated(noise: Bands, table: Reals, intensity: Reals, range_m: Reals) -> Reals:
    """Return the values of a table, linear between its knots, those of the ends beyond."""
    rows = np.stack([np.interp(range_m, noise.range_m, row) for row in table])
    place = np.interp(intensity, noise.intensity, np.arange(len(rows), dtype=np.float64))
    below = np.minimum(place.astype(np.intp), max(len(rows) - 2, 0))
    above = np.minimum(below + 1, len(rows) - 1)
    each = np.arange(len(place))
    value: Reals = rows[below, each] + (place - below) * (rows[above, each] - rows[below, each])
    return value


def _filled(range_m: Reals, table: Reals) -> Reals:
    """Return a table with numbers for NaN: along each row, or 0 in an empty one."""
    rows = []
    for row in table:
        known = np.isfinite(row)
        rows.append(np.interp(range_m, range_m[known], row[known]) if known.any() else 0 * range_m)
    return np.array(rows)


def fit_sheet(recording: Path, topic: str | None, base: CheckedDatasheet) -> FittedSheet:
    """Return the sheet of a recording, a `Fitter`.

    Raises
    ------
    UserError
        as `read_firings` and `fit` do.
    """
    return fitted_sheet(fit(read_firings(recording, topic), str(recording)), base.figures)


def fitted_sheet(found: EchoFit, base: Mapping[str, Any]) -> FittedSheet:
    """Return a base sheet's figures with a fitted `echo_bands`."""
    windows = len(found.windows.laser)
    bands = echo_bands(found)
    figures = {name: value for name, value in base.items() if name not in REPLACED}
    if found.step_m:
        figures["range_resolution_m"] = found.step_m
    return FittedSheet(
        fitted="noise and dropout",
        comments=[
            f"Firings: {found.firings}; windows of {WINDOW} on smooth surfaces: {windows}.",
            *_residuals(found),
        ],
        figures=figures | {"echo_bands": bands},
        notes={
            "echo_bands": [
                "White noise, 1 sigma, and share of lost returns, by intensity, then by range."
            ]
        },
        printed=[*_table(found.noise), f"{windows} windows of smooth surfaces"],
        document={"windows": windows, "echo_bands": bands},
    )


def _table(noise: Bands) -> Iterator[str]:
    """Yield the lines of a table of noise."""
    yield "Noise in millimeters, 1 sigma, by intensity and range:"
    yield f"{'':>9}" + "".join(f"{place:>8.1f} m" for place in noise.range_m)
    for intensity, row in zip(noise.intensity, noise.value, strict=True):
        cells = (f"{1e3 * sigma:10.1f}" if np.isfinite(sigma) else f"{'-':>10}" for sigma in row)
        yield f"{intensity:9.1f}" + "".join(cells)


def _residuals(found: EchoFit) -> list[str]:
    """Return what the table leaves out."""
    noise = ", ".join(
        f"{ratio:.2f} at {degrees:.0f} degrees"
        for degrees, ratio, _ in noise_by_incidence(found.windows, found.noise)
    )
    light = ", ".join(
        f"{median:.0f} (within a window 1 sigma {100 * spread:.0f} %) at {degrees:.0f} degrees"
        for degrees, median, spread in intensity_by_incidence(found.windows)
    )
    return [
        f"Noise over the table's, by incidence: {noise}.",
        f"Median intensity by incidence: {light}.",
    ]
