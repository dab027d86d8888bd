# SPDX-License-Identifier: Apache-2.0
"""Results of trials of a vehicle: figures with their limits, and curves. Physics measures them."""

import msgspec


class TrialFigure(msgspec.Struct, frozen=True):
    """A measured figure."""

    name: str
    value: float
    unit: str
    expected: str
    """The limit as text; empty: any value is fine."""

    good: bool

    def __str__(self) -> str:
        return f"{round(self.value, 4) + 0.0:.4g} {self.unit}".rstrip()  # No minus zero.


class TrialCurve(msgspec.Struct, frozen=True):
    """A curve: what was measured, what was commanded, or the ground."""

    name: str
    x: tuple[float, ...]
    y: tuple[float, ...]


class TrialPlot(msgspec.Struct, frozen=True):
    """Curves over common axes."""

    x_label: str
    y_label: str
    curves: tuple[TrialCurve, ...]
    equal: bool = False
    """Whether both axes have the same scale, as a map or a side view has."""


class Trial(msgspec.Struct, frozen=True):
    """One trial of a vehicle."""

    name: str
    description: str
    """What was done."""

    figures: tuple[TrialFigure, ...]
    plots: tuple[TrialPlot, ...]
    fix: str
    """What to try if a figure is not as expected."""

    @property
    def good(self) -> bool:
        """Whether all figures are as expected."""
        return all(figure.good for figure in self.figures)
