# SPDX-License-Identifier: Apache-2.0
"""Schema conversion with error lines that name file, line, field and the nearest valid word."""

from __future__ import annotations

import re
from typing import Any, TypeVar

import msgspec

from groundlink.core.errors import did_you_mean
from groundlink.scenario.every_sensor import PATTERNS

from .document import DataPath, Document, ScenarioError
from .fields import choices, field_names, kinds, required_names

S = TypeVar("S", bound=msgspec.Struct)


def convert(document: Document, schema: type[S]) -> S:
    """Convert plain data to a schema.

    Raises
    ------
    ScenarioError
        for the first value that does not fit.
    """
    try:
        return msgspec.convert(document.value, schema)
    except msgspec.ValidationError as error:
        raise ScenarioError(explained(error, document, schema)) from None


def explained(error: msgspec.ValidationError, document: Document, schema: Any) -> str:
    """Return a validation error as one line with its source line and a hint."""
    problem, _, where = str(error).partition(" - at ")
    path = _data_path(where.strip("`"), document, schema)
    if unknown := re.search(r"contains unknown field `(.*)`", problem):
        key = unknown.group(1)
        names = field_names(schema, document.value, path)
        absent = required_names(schema, document.value, path) - set(document.at(path))
        mark = document.mark((*path, key))
        return f"{mark}: unknown key `{dotted((*path, key))}`; {did_you_mean(key, names, absent)}"
    mark = document.mark(path)
    if missing := re.search(r"missing required field `(.*)`", problem):
        return f"{mark}: `{dotted((*path, missing.group(1)))}` is missing; add it"
    if invalid := re.search(r"Invalid value '(.*)'$", problem):
        known = kinds(schema, document.value, path)
        if known:
            word = invalid.group(1)
            return f"{mark}: `{dotted(path)}`: unknown kind `{word}`; {did_you_mean(word, known)}"
    if invalid := re.search(r"Invalid enum value '(.*)'$", problem):
        word, known = invalid.group(1), choices(schema, document.value, path)
        return f"{mark}: `{dotted(path)}`: unknown value `{word}`; {did_you_mean(word, known)}"
    if pattern := re.search(r"expected `str` matching regex (.*)$", problem, re.IGNORECASE):
        asked = {repr(known): words for known, words in PATTERNS.items()}
        problem = f"expected {asked.get(pattern.group(1), problem)}"
    value = document.at(path)
    given = "" if isinstance(value, dict | list) else f" (given: {value!r})"
    field = f"`{dotted(path)}`: " if path else ""
    return f"{mark}: {field}{problem[:1].lower()}{problem[1:]}{given}"


def dotted(path: DataPath) -> str:
    """Return a path as text, such as `vehicles[0].name`."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.lstrip(".")


def _data_path(text: str, document: Document, schema: Any) -> DataPath:
    """Parse msgspec's `$.vehicles[0].name`, where `[...]` stands for some key of a mapping."""
    path: DataPath = ()
    for name, index, some_key in re.findall(r"\.([A-Za-z_]\w*)|\[(\d+)\]|(\[\.\.\.\])", text):
        step = _wrong_key(document, path, schema) if some_key else name or int(index)
        path = path if step is None else (*path, step)
    return path


def _wrong_key(document: Document, path: DataPath, schema: Any) -> str | None:
    """Return the key of a mapping whose value alone fails validation."""
    around, step, mapping = document.at(path[:-1]), path[-1], document.at(path)
    try:
        for key, value in mapping.items():
            around[step] = {key: value}
            try:
                msgspec.convert(document.value, schema)
            except msgspec.ValidationError as error:
                if "[...]" in str(error):
                    return str(key)
        return None
    finally:
        around[step] = mapping
