# SPDX-License-Identifier: Apache-2.0
"""Schema conversion with error lines that name file, line, field and the nearest valid word."""

import re
from typing import Any, TypeVar

import msgspec
from msgspec.inspect import (
    DictType,
    ListType,
    LiteralType,
    StructType,
    Type,
    UnionType,
    VarTupleType,
    type_info,
)

from groundlink.core.errors import did_you_mean
from groundlink.scenario.every_sensor import PATTERNS

from .document import DataPath, Document, ScenarioError

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
        names, required = _keys(schema, document.value, path)
        hint = did_you_mean(key, names, required - set(document.at(path)))
        return f"{document.mark((*path, key))}: unknown key `{dotted((*path, key))}`; {hint}"
    mark = document.mark(path)
    if missing := re.search(r"missing required field `(.*)`", problem):
        return f"{mark}: `{dotted((*path, missing.group(1)))}` is missing; add it"
    if invalid := re.search(r"Invalid value '(.*)'$", problem):
        known = _kinds(schema, document.value, path)
        if known:
            word = invalid.group(1)
            return f"{mark}: `{dotted(path)}`: unknown kind `{word}`; {did_you_mean(word, known)}"
    if invalid := re.search(r"Invalid enum value '(.*)'$", problem):
        word, known = invalid.group(1), _choices(schema, document.value, path)
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


def _keys(root: type, data: Any, path: DataPath) -> tuple[list[str], set[str]]:
    """Return the keys that the structure at `path` may have, and those that it must have."""
    structs = _structs(_walk(type_info(root), data, path), _tag(data, path))
    fields = [field for struct in structs for field in struct.fields]
    tags = [struct.tag_field for struct in structs if struct.tag_field]
    names = [field.encode_name for field in fields]
    return [*names, *tags], {field.encode_name for field in fields if field.required}


def _kinds(root: type, data: Any, path: DataPath) -> list[str]:
    """Return the values that the tag at `path` may have; none where it is no tag."""
    structs = _structs(_walk(type_info(root), data, path[:-1]), None)
    return [str(s.tag) for s in structs if s.tag is not None and s.tag_field == path[-1]]


def _choices(root: type, data: Any, path: DataPath) -> list[str]:
    """Return the words that the value at `path` may be; none where it is no choice of words."""
    type_ = _walk(type_info(root), data, path)
    members = type_.types if isinstance(type_, UnionType) else (type_,)
    return [str(w) for member in members if isinstance(member, LiteralType) for w in member.values]


def _tag(data: Any, path: DataPath) -> Any:
    for step in path:
        data = data[step]
    return data.get("kind") if isinstance(data, dict) else None


def _structs(type_: Type, tag: Any) -> list[StructType]:
    """Return the structures of a type: of a union the one with the tag, or all."""
    members = type_.types if isinstance(type_, UnionType) else (type_,)
    structs = [member for member in members if isinstance(member, StructType)]
    return [struct for struct in structs if tag is not None and struct.tag == tag] or structs


def _walk(type_: Type, data: Any, path: DataPath) -> Type:
    """Follow a path through the types, choosing in unions by the data's own tags."""
    for step in path:
        tag = data.get("kind") if isinstance(data, dict) else None
        data = data[step]
        if isinstance(type_, UnionType | StructType):
            candidates = [
                f for s in _structs(type_, tag) for f in s.fields if f.encode_name == step
            ]
            if not candidates:
                return type_info(msgspec.UnsetType)
            type_ = candidates[0].type
        elif isinstance(type_, ListType | VarTupleType):
            type_ = type_.item_type
        elif isinstance(type_, DictType):
            type_ = type_.value_type
        if isinstance(type_, UnionType) and not any(isinstance(t, StructType) for t in type_.types):
            inner = [t for t in type_.types if isinstance(t, ListType | VarTupleType | DictType)]
            type_ = inner[0] if inner else type_
    return type_
