# SPDX-License-Identifier: Apache-2.0
"""Data sheets of satellite receivers from recordings at rest.

White noise and drift are fitted to the Allan variance, of east and north together and of the
altitude; both drifts have one time constant. An error that stays over the recording does not show.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from groundlink.core.errors import UserError
from groundlink.loader.datasheets import CheckedDatasheet

from .allan import CurveFit, NoiseCurve, allan_table, fit_curves
from .positions import Positions, read_positions
from .series import allan_bands
from .sheet_file import FittedSheet, short

GROUPS = {"horizontal": (0, 2), "vertical": (2, 3)}
"""Axes of the series by the field of the sheet."""

AXES = {"horizontal": ("east", "north"), "vertical": ("up",)}
CHOICES = [("white",), ("white", "drift"), ("white", "drift", "time_s")]

FIELDS = {"white": "white_stddev_m", "drift": "drift_stddev_m"}
"""Field of the sheet by that of `NoiseCurve`."""


class ReceiverFit(NamedTuple):
    """What a recording says about a receiver."""

    curves: Mapping[str, CurveFit]
    """By the field of the sheet."""

    period_s: float

    def fields(self) -> dict[str, dict[str, float]]:
        """Return the errors of `horizontal` and `vertical` that the recording shows."""
        return {
            name: {
                FIELDS[of]: short(_stddev(of, getattr(found.curve, of), self.period_s))
                for of in found.fitted
                if of in FIELDS
            }
            for name, found in self.curves.items()
        }

    def time_s(self) -> float | None:
        """Return the time constant of the drift, None if the recording does not show it."""
        one = self.curves["horizontal"]
        return short(one.curve.time_s) if "time_s" in one.fitted else None


def _stddev(of: str, size: float, period_s: float) -> float:
    """Return the sigma of each fix; of white noise, its density over the root of the period."""
    return size / period_s**0.5 if of == "white" else size


def fit_sheet(recording: Path, topic: str | None, base: CheckedDatasheet) -> FittedSheet:
    """Return the sheet of a recording, a `Fitter`.

    Raises
    ------
    UserError
        as `read_positions` does, or when the sheet lacks the recording's type of solution.
    """
    return fitted_sheet(read_positions(recording, topic), base)


def fit(positions: Positions, base: CheckedDatasheet) -> ReceiverFit:
    """Return what a recording says; `base` has the values of what it is too short for."""
    figures = _errors_of(base, positions.solution)
    sensor: Any = base.sensor()
    period = positions.series.period_s
    groups = [allan_bands(positions.series.axes(*axes)) for axes in GROUPS.values()]
    bases = [
        NoiseCurve(
            figures.get(name, {}).get("white_stddev_m", 0.0) * period**0.5,
            figures.get(name, {}).get("drift_stddev_m", 0.0),
            sensor.drift_time_s,
            sample_s=period,
        )
        for name in GROUPS
    ]
    return ReceiverFit(dict(zip(GROUPS, fit_curves(groups, bases, CHOICES), strict=True)), period)


def _errors_of(base: CheckedDatasheet, solution: str) -> Mapping[str, Any]:
    """Return the fields of a sheet that have the errors of a type of solution."""
    solutions = base.figures.get("solutions")
    if not solutions:
        return base.figures
    for one in solutions:
        if one["type"] == solution:
            errors: Mapping[str, Any] = one
            return errors
    types = ", ".join(one["type"] for one in solutions)
    raise UserError(
        f"{base.file}: solutions: none of type {solution}, which the recording has; expected one "
        f"of {types}. Fix: take another base sheet"
    )


def fitted_sheet(positions: Positions, base: CheckedDatasheet) -> FittedSheet:
    """Return a base sheet's figures with those of a recording in their place."""
    found = fit(positions, base)
    own = _errors_of(base, positions.solution)
    errors = {name: own.get(name, {}) | fields for name, fields in found.fields().items()}
    figures: dict[str, Any] = dict(base.figures)
    if "solutions" in figures:
        changed = {one["type"]: one for one in figures["solutions"]}
        changed[positions.solution] = changed[positions.solution] | errors
        figures["solutions"] = list(changed.values())
    else:
        figures |= errors | {"solution": positions.solution}
    time_s = found.time_s()
    if time_s is not None:
        figures["drift_time_s"] = time_s
    series = positions.series
    comments = [
        f"Length: {series.seconds:.0f} s at rest, {series.readings} fixes at "
        f"{1 / series.period_s:.4g} Hz of type {positions.solution}, "
        f"{len(series.segments)} segment(s); {positions.left_out} of other types left out."
    ]
    for name, curve in found.curves.items():
        comments += allan_table(f"the {name} position, m", curve, AXES[name])
    fitted = [
        f"{name}.{FIELDS.get(of, 'drift_time_s')} +-{100 * error:.0f} %"
        for name, curve in found.curves.items()
        for of, error in curve.errors.items()
    ]
    comments.append(f"Fitted: {', '.join(fitted)}.")
    shown = found.curves["horizontal"].fitted
    kept = [field for of, field in (FIELDS | {"time_s": "drift_time_s"}).items() if of not in shown]
    if kept:
        comments.append(f"The base's, as the recording does not show them: {', '.join(kept)}.")
    document = {
        "figures": errors | {"drift_time_s": figures.get("drift_time_s")},
        "solution": positions.solution,
        "bands": {name: curve.rows() for name, curve in found.curves.items()},
    }
    return FittedSheet("noise and drift", comments, figures, {}, comments, document)
