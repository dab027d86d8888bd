# SPDX-License-Identifier: Apache-2.0
"""Reference of the bus in Markdown: keys of all streams and fields of all messages.

Generated from the table of topics and the message classes. The meaning of a field is its docstring
in the source. The text is part of `docs/reference/bus.md`.
"""

import inspect
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import inspect as types

from groundlink.core.field_docs import field_descriptions
from groundlink.messages.base import POINT
from groundlink.messages.ground_truth import LABELED_POINT, TRUE_POINT

from .core_topics import ROOT
from .topics import TOPICS


def reference() -> str:
    """Return the tables of keys and messages."""
    lines = [
        "## Keys",
        "",
        f"All keys begin with `{ROOT}/<run>/`. `newest`: the sender never waits, a slow receiver",
        "misses messages. `all`: the sender waits for room.",
        "",
        *_table(
            ("key", "message", "rate", "publisher", "delivery"),
            (
                (
                    f"`{topic.key}`",
                    f"[{topic.message.__name__}](#{topic.message.__name__.lower()})",
                    topic.rate,
                    topic.publisher,
                    topic.delivery.value,
                )
                for topic in TOPICS
            ),
        ),
        "",
        "## Messages",
    ]
    waiting: list[type[Any]] = list(dict.fromkeys(topic.message for topic in TOPICS))
    known: list[type[Any]] = []
    while waiting:
        struct = waiting.pop(0)
        if struct in known:
            continue
        known.append(struct)
        found: list[type[Any]] = []
        lines += ["", *_section(struct, found)]
        waiting = found + waiting
    lines += ["", "## Records"]
    records = {"POINT": POINT, "TRUE_POINT": TRUE_POINT, "LABELED_POINT": LABELED_POINT}
    for name, record in records.items():
        lines += ["", f"### {name}", "", f"{record.itemsize} bytes, little-endian.", ""]
        fields: Mapping[str, Any] = record.fields or {}
        rows = ((f"`{n}`", str(at), kind.name) for n, (kind, at, *_) in fields.items())
        lines += _table(("field", "offset", "type"), rows)
    return "\n".join(lines) + "\n"


def _section(struct: type[Any], found: list[type[Any]]) -> Iterator[str]:
    """Yield the section of a struct; append the structs that it contains to `found`."""
    yield f"### {struct.__name__}"
    yield ""
    yield _joined(inspect.getdoc(struct) or "")
    yield ""
    docs = field_descriptions(struct)
    info = types.type_info(struct)
    assert isinstance(info, types.StructType)
    rows = []
    if info.tag_field is not None:
        rows.append((f"`{info.tag_field}`", f'"{info.tag}"', ""))
    for field in info.fields:
        default = "" if field.required else "optional. "
        kind = _kind(field.type, found)
        meaning = _joined(docs.get(field.encode_name, ""))
        rows.append((f"`{field.encode_name}`", kind, default + meaning))
    yield from _table(("field", "type", "meaning"), rows)


def _kind(field: types.Type, found: list[type[Any]]) -> str:
    """Return the MessagePack name of a type."""
    match field:
        case types.StructType():
            found.append(field.cls)
            return f"[{field.cls.__name__}](#{field.cls.__name__.lower()})"
        case types.UnionType():
            return " or ".join(_kind(member, found) for member in field.types)
        case types.DictType():
            return f"map of {_kind(field.key_type, found)} to {_kind(field.value_type, found)}"
        case types.VarTupleType() | types.ListType():
            return f"array of {_kind(field.item_type, found)}"
        case types.TupleType():
            return f"array of {len(field.item_types)} {_kind(field.item_types[0], found)}"
        case types.LiteralType():
            return " or ".join(f'"{value}"' for value in field.values)
        case types.MemoryViewType() | types.BytesType():
            return "bin"
        case types.NoneType():
            return "nil"
    return type(field).__name__.removesuffix("Type").lower()


def _joined(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _table(head: tuple[str, ...], rows: Any) -> Iterator[str]:
    for cells in (head, ("---",) * len(head), *rows):
        yield f"| {' | '.join(cells)} |"
