# SPDX-License-Identifier: Apache-2.0
"""A data sheet with the noise and dropout of a recording in place of the maker's figures."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import yaml

from groundlink.core.errors import UserError

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


def sheet_text(base: Mapping[str, Any], base_name: str, source: str, found: EchoFit) -> str:
    """Return the text of a data sheet: the base's figures with a fitted `echo_bands`.

    Parameters
    ----------
    base : mapping
        The sheet of the device, with `kind` and `datasheet`.
    base_name, source : str
        Names of the base and of the recording, for the reader of the sheet.
    found : EchoFit
    """
    windows = len(found.windows.laser)
    title = " ".join(str(base.get("datasheet", base_name)).split())
    kept = {
        name: value for name, value in base.items() if name not in ("kind", "datasheet", *REPLACED)
    }
    if found.step_m:
        kept["range_resolution_m"] = found.step_m
    lines = [
        "# SPDX-License-Identifier: Apache-2.0",
        "# yaml-language-server: $schema=../schemas/datasheet.json",
        f"# Data sheet: {base_name} with noise and dropout of a recording, by `groundlink fit`.",
        f"# Geometry and the other figures: {base_name}.yaml, where their sources stand.",
        f"# Recording: {source}",
        f"# Firings: {found.firings}; windows of {WINDOW} on smooth surfaces: {windows}.",
        *_residuals(found),
        f"kind: {base['kind']}",
        _yaml("datasheet", f"{title}; noise and dropout of a recording"),
        *(_yaml(name, value) for name, value in kept.items()),
        "",
        "# White noise, 1 sigma, and share of lost returns, by intensity, then by range.",
        "echo_bands:",
        *(f"  {_yaml(name, value)}" for name, value in echo_bands(found).items()),
    ]
    return "\n".join(lines) + "\n"


def _residuals(found: EchoFit) -> list[str]:
    """Return comments on what the table leaves out."""
    noise = ", ".join(
        f"{ratio:.2f} at {degrees:.0f} degrees"
        for degrees, ratio, _ in noise_by_incidence(found.windows, found.noise)
    )
    light = ", ".join(
        f"{median:.0f} (within a window 1 sigma {100 * spread:.0f} %) at {degrees:.0f} degrees"
        for degrees, median, spread in intensity_by_incidence(found.windows)
    )
    return [
        f"# Noise over the table's, by incidence: {noise}.",
        f"# Median intensity by incidence: {light}.",
    ]


def _yaml(name: str, value: Any) -> str:
    """Return one field on one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=math.inf, allow_unicode=True)
    return f"{name}: " + text.removesuffix("...\n").strip()
