# SPDX-License-Identifier: Apache-2.0
"""Fields in which two descriptions as plain data differ."""

from collections.abc import Callable, Iterator
from typing import Any

FieldPath = tuple[str | int, ...]
"""Keys of dicts and numbers of list elements."""


def differing_fields(
    good: Any, bad: Any, absent: Callable[[FieldPath], Any], path: FieldPath = ()
) -> Iterator[tuple[FieldPath, Any]]:
    """Yield the smallest fields that differ, with their values in `bad`.

    Lists whose elements have the same names are compared element by element, all others are one
    value. So are dicts of different kinds.

    Parameters
    ----------
    good, bad
        dicts and lists of plain values.
    absent
        returns the value of a field that `bad` leaves out.
    path
        path of both in their documents.
    """
    if _are_alike(good, bad):
        for key in dict.fromkeys((*good, *bad)):
            inner = (*path, key)
            value = bad[key] if key in bad else absent(inner)
            if key in good:
                yield from differing_fields(good[key], value, absent, inner)
            else:
                yield inner, value
    elif isinstance(good, list) and isinstance(bad, list) and _names(good) == _names(bad) != []:
        for number, parts in enumerate(zip(good, bad, strict=True)):
            yield from differing_fields(*parts, absent, (*path, number))
    elif good != bad:
        yield path, bad


def _are_alike(good: Any, bad: Any) -> bool:
    """Return whether the fields of both mean the same."""
    return isinstance(good, dict) and isinstance(bad, dict) and good.get("kind") == bad.get("kind")


def _names(elements: list[Any]) -> list[str]:
    """Return the names of a list's elements; none if one of them has no name."""
    names = [each.get("name") if isinstance(each, dict) else None for each in elements]
    return [] if None in names else [str(name) for name in names]
