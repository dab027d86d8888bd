# SPDX-License-Identifier: Apache-2.0
"""Schema inspection: the keys, tags and literals allowed at a path, for hints in error lines."""

from __future__ import annotations

from typing import Any

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


def field_names(root: type, data: Any, path: tuple[str | int, ...]) -> list[str]:
    """Return the keys that the structure at `path` may have."""
    names: list[str] = []
    for struct in _structs(_walk(type_info(root), data, path), _tag(data, path)):
        names += [field.encode_name for field in struct.fields]
        names += [struct.tag_field] if struct.tag_field else []
    return names


def required_names(root: type, data: Any, path: tuple[str | int, ...]) -> set[str]:
    """Return the keys that the structure at `path` must have."""
    structs = _structs(_walk(type_info(root), data, path), _tag(data, path))
    return {f.encode_name for struct in structs for f in struct.fields if f.required}


def kinds(root: type, data: Any, path: tuple[str | int, ...]) -> list[str]:
    """Return the values that the tag at `path` may have; none where it is no tag."""
    structs = _structs(_walk(type_info(root), data, path[:-1]), None)
    return [str(s.tag) for s in structs if s.tag is not None and s.tag_field == path[-1]]


def choices(root: type, data: Any, path: tuple[str | int, ...]) -> list[str]:
    """Return the words that the value at `path` may be; none where it is no choice of words."""
    type_ = _walk(type_info(root), data, path)
    members = type_.types if isinstance(type_, UnionType) else (type_,)
    return [str(w) for member in members if isinstance(member, LiteralType) for w in member.values]


def _tag(data: Any, path: tuple[str | int, ...]) -> Any:
    for step in path:
        data = data[step]
    return data.get("kind") if isinstance(data, dict) else None


def _structs(type_: Type, tag: Any) -> list[StructType]:
    """Return the structures of a type: of a union the one with the tag, or all."""
    members = type_.types if isinstance(type_, UnionType) else (type_,)
    structs = [member for member in members if isinstance(member, StructType)]
    return [struct for struct in structs if tag is not None and struct.tag == tag] or structs


def _walk(type_: Type, data: Any, path: tuple[str | int, ...]) -> Type:
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
