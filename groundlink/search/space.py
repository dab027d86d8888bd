# SPDX-License-Identifier: Apache-2.0
"""Space of a search: the fields that it varies, each over a grid of values or a list.

Without a step, a range of fractions is divided into 1,000 to 10,000 steps of a power of ten, so
that a value is short: `1.234`, not `1.2340192837`. A value is identified by its index.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal, InvalidOperation
from pathlib import Path
from typing import Any, Protocol

from groundlink.core.errors import UserError
from groundlink.loader.document import parse

FORM = "FIELD=LOW..HIGH, FIELD=LOW..HIGH/STEP or FIELD=VALUE,VALUE,..."

LEAST_STEPS = 1000
"""A range of fractions has at least this many steps."""

MAX_BINS = 10
"""Number of equal bins of a range with more values."""

Point = dict[str, Any]
"""Values by field. A field that is left out has the scenario's value."""


class VariedField(Protocol):
    """A field and the values that it can take."""

    @property
    def name(self) -> str:
        """Path of the field, as in `--set`."""

    @property
    def count(self) -> int:
        """Number of values."""

    @property
    def bins(self) -> Sequence[str]:
        """Labels of the bins in which coverage is counted."""

    def value(self, index: int) -> Any:
        """Return a value by its index, 0 to `count` - 1."""

    def bin_of(self, value: Any) -> int | None:
        """Return the bin of a value, None outside of all."""

    def position(self, value: Any) -> float:
        """Return the place of a value on an axis."""

    def between(self, one: Any, other: Any) -> Any | None:
        """Return the value halfway between two, None if there is none."""

    def __str__(self) -> str:
        """Return the field with its values as `--vary` takes it."""


@dataclass(frozen=True)
class NumberRange:
    """Numbers from `low` to `high`, both included, in equal steps."""

    name: str
    low: Decimal
    high: Decimal
    step: Decimal

    @property
    def count(self) -> int:
        """Number of values."""
        return math.ceil((self.high - self.low) / self.step) + 1

    @property
    def bins(self) -> Sequence[str]:
        """Labels of the bins: their lower ends."""
        count = min(self.count, MAX_BINS)
        width = (float(self.high) - float(self.low)) / count
        if count == self.count:
            return [str(self.value(index)) for index in range(count)]
        return [f"{float(self.low) + width * index:.4g}" for index in range(count)]

    @property
    def _is_whole(self) -> bool:
        return all(part == part.to_integral_value() for part in (self.low, self.high, self.step))

    def value(self, index: int) -> int | float:
        """Return a value by its index."""
        return self._number(min(self.low + index * self.step, self.high))

    def bin_of(self, value: Any) -> int | None:
        """Return the bin of a value, None outside of the range."""
        if not _is_number(value) or not self.low <= Decimal(str(value)) <= self.high:
            return None
        count = min(self.count, MAX_BINS)
        if count == self.count:
            return round((Decimal(str(value)) - self.low) / self.step)
        share = (Decimal(str(value)) - self.low) / (self.high - self.low)
        return min(int(share * count), count - 1)

    def position(self, value: Any) -> float:
        """Return the value itself, NaN if it is no number."""
        return float(value) if _is_number(value) else math.nan

    def between(self, one: Any, other: Any) -> int | float | None:
        """Return the value of the grid nearest to the middle of two numbers."""
        if not (_is_number(one) and _is_number(other)):
            return None
        ends = sorted((Decimal(str(one)), Decimal(str(other))))
        steps = ((ends[0] + ends[1]) / 2 - self.low) / self.step
        middle = self.low + steps.quantize(Decimal(1), ROUND_HALF_EVEN) * self.step
        return self._number(middle) if ends[0] < middle < ends[1] else None

    def _number(self, value: Decimal) -> int | float:
        return int(value) if self._is_whole else float(value)

    def __str__(self) -> str:
        step = "" if self.step == _step(self.low, self.high) else f"/{self.step}"
        return f"{self.name}={self.low}..{self.high}{step}"


@dataclass(frozen=True)
class ValueList:
    """A list of values without an order."""

    name: str
    values: tuple[Any, ...]

    @property
    def count(self) -> int:
        """Number of values."""
        return len(self.values)

    @property
    def bins(self) -> Sequence[str]:
        """Labels of the bins: the values."""
        return [value_text(value) for value in self.values]

    def value(self, index: int) -> Any:
        """Return a value by its index."""
        return self.values[index]

    def bin_of(self, value: Any) -> int | None:
        """Return the index of a value, None if it is not listed."""
        return self.values.index(value) if value in self.values else None

    def position(self, value: Any) -> float:
        """Return the index of a value, NaN if it is not listed."""
        index = self.bin_of(value)
        return math.nan if index is None else float(index)

    def between(self, one: Any, other: Any) -> None:
        """Return None: values of a list have no middle."""

    def __str__(self) -> str:
        return f"{self.name}={','.join(self.bins)}"


@dataclass(frozen=True)
class Space:
    """All points whose fields have one of their values each."""

    fields: tuple[VariedField, ...]

    @property
    def size(self) -> int:
        """Number of points."""
        return math.prod(field.count for field in self.fields)

    def point(self, indices: Sequence[int]) -> Point:
        """Return the point with these indices, one for each field."""
        pairs = zip(self.fields, indices, strict=True)
        return {field.name: field.value(index) for field, index in pairs}


def space(texts: Sequence[str]) -> Space:
    """Return the space of arguments of `--vary`.

    Raises
    ------
    UserError
        when an argument has another form, or a field stands twice.
    """
    fields = tuple(map(varied_field, texts))
    names = [field.name for field in fields]
    for name in names:
        if names.count(name) > 1:
            raise UserError(f"--vary {name}: given twice. Fix: keep one")
    return Space(fields)


def varied_field(text: str) -> VariedField:
    """Return the field of an argument of `--vary`.

    Raises
    ------
    UserError
        when it has another form.
    """
    name, _, values = text.partition("=")
    low, dots, high = values.partition("..")
    if not values or not all(name.split(".")):
        raise UserError(f"--vary {text}: expected {FORM}")
    high, slash, step = high.partition("/")
    if dots and (ends := _numbers(low, high, *([step] if slash else []))):
        if not ends[0] < ends[1]:
            raise UserError(f"--vary {text}: expected LOW..HIGH with LOW below HIGH")
        steps = ends[2] if slash else _step(ends[0], ends[1])
        if not 0 < steps <= ends[1] - ends[0]:
            raise UserError(f"--vary {text}: step {step}; expected more than 0, up to HIGH - LOW")
        return NumberRange(name, ends[0], ends[1], steps)
    listed = parse(f"[{values}]", Path(f"--vary {text}")).value
    if len(listed) < 2:
        raise UserError(f"--vary {text}: one value; expected {FORM}")
    if any(value in listed[:number] for number, value in enumerate(listed)):
        raise UserError(f"--vary {text}: a value stands twice. Fix: keep one")
    return ValueList(name, tuple(listed))


def point_text(values: Mapping[str, Any]) -> str:
    """Return values by field as text, such as `lidar.dropout=0.1, seed=2`."""
    return ", ".join(f"{name}={value_text(value)}" for name, value in values.items())


def value_text(value: Any) -> str:
    """Return a value as text."""
    return value if isinstance(value, str) else json.dumps(value)


def nearness(point: Point, origin: Mapping[str, Any], searched: Space) -> tuple[int, float]:
    """Return how far a point is from the scenario, for comparison with others.

    Returns
    -------
    Number of changed fields, and the sum of the changes of numbers as shares of their ranges.
    """
    changes = 0.0
    for field in searched.fields:
        if isinstance(field, NumberRange) and field.name in point:
            change = field.position(point[field.name]) - field.position(origin[field.name])
            changes += 0.0 if math.isnan(change) else abs(change / float(field.high - field.low))
    return sum(value != origin[name] for name, value in point.items()), changes


def _numbers(*texts: str) -> list[Decimal] | None:
    try:
        numbers = [Decimal(text) for text in texts]
    except InvalidOperation:
        return None
    return numbers if all(number.is_finite() for number in numbers) else None


def _step(low: Decimal, high: Decimal) -> Decimal:
    """Return the step of a range: 1 if both ends are written as whole numbers."""
    if all(end.as_tuple().exponent == 0 for end in (low, high)):
        return Decimal(1)
    return Decimal(1).scaleb(((high - low) / LEAST_STEPS).adjusted())


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
