# SPDX-License-Identifier: Apache-2.0
"""Reference of scenario fields: what a JSON schema says about each field, found by its path.

Source of `groundlink explain` and of the page of scenario fields. A path has the names of fields
and kinds as in a scenario: `vehicles.sensors.lidar.dropout`. Entries of lists have no step of their
own.
"""

import json
import re
from collections import deque
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any, NamedTuple

from groundlink.core.errors import UserError, did_you_mean
from groundlink.core.field_docs import summary
from groundlink.scenario.every_sensor import PATTERNS

from .json_schema import RESOLVED, TOPIC_IN_FILES, Schema

TAG = "kind"
"""Field that selects one of several structs."""

UNITS = {
    "_per_m": "1/m",
    "_per_s": "1/s",
    "_mm_per_h": "mm/h",
    "_ah": "Ah",
    "_deg": "deg",
    "_degps": "deg/s",
    "_electrons": "electrons",
    "_hz": "Hz",
    "_kb": "kB",
    "_kg": "kg",
    "_kgm2": "kg m^2",
    "_kgpm3": "kg/m^3",
    "_m": "m",
    "_m2": "m^2",
    "_mbps": "Mbit/s",
    "_mps": "m/s",
    "_mps2": "m/s^2",
    "_mrad": "mrad",
    "_ms": "ms",
    "_nm": "N m",
    "_nmsprad": "N m s/rad",
    "_npm": "N/m",
    "_npm3": "N/m^3",
    "_npm4": "N/m^4",
    "_ns": "ns",
    "_nspm": "N s/m",
    "_ohm": "ohm",
    "_pa": "Pa",
    "_px": "px",
    "_radps": "rad/s",
    "_radps2": "rad/s^2",
    "_s": "s",
    "_t": "T",
    "_us": "us",
    "_v": "V",
    "_w": "W",
}
"""Unit of a field by the end of its name. The longest end that matches counts."""

_WORDS = {
    "string": "text",
    "number": "number",
    "integer": "integer",
    "boolean": "true or false",
    "null": "none",
    "object": "mapping",
    "array": "list",
}
"""Types of JSON in the words of the reference."""

_BOUNDS = {
    "minimum": "from {:.15g}",
    "exclusiveMinimum": "above {:.15g}",
    "maximum": "up to {:.15g}",
    "exclusiveMaximum": "below {:.15g}",
}

_COUNTS = {"minItems": "{} or more entries", "maxItems": "up to {} entries"}

_PATTERNS = PATTERNS | {TOPIC_IN_FILES: "letters, digits, underscores and slashes"}


class Section(NamedTuple):
    """A struct of a scenario: one table of fields."""

    path: str
    """Shortest path to the struct; empty for the scenario itself. A field that all kinds of a
    choice have in common has the path of the choice."""

    title: str
    """Name of the struct."""

    kind: str
    """Kind that selects the struct among others; empty if there is no choice."""

    description: str
    fields: dict[str, "ScenarioField"]


class ScenarioField(NamedTuple):
    """A field of a scenario."""

    path: str
    type: str
    unit: str
    """Empty for a field without a unit, or whose unit depends on other fields."""

    default: str
    """The value as in a file, or `required`; empty for a default that the schema does not state."""

    range: str
    description: str
    structs: tuple[str, ...]
    """Titles of the structs that the value can be, alone or in a list or mapping."""

    kinds: tuple[str, ...]
    """Kinds that select one of these structs; empty if there is no choice."""


class FieldReference:
    """All fields of a file's schema.

    Parameters
    ----------
    schema
        as `json_schema` makes it, with one definition at its root.
    """

    def __init__(self, schema: Schema) -> None:
        self._definitions: dict[str, Schema] = schema["$defs"]
        self.sections: dict[str, Section] = {}
        (root,) = self._structs(schema)
        due: deque[tuple[str, Schema, str, frozenset[str]]] = deque([("", root, "", frozenset())])
        while due:
            parent, struct, kind, shared = due.popleft()
            if struct["title"] in self.sections:
                continue
            path = _path(parent, kind)
            fields = {
                name: self._field(_path(parent if name in shared else path, name), struct, node)
                for name, node in struct["properties"].items()
            }
            about = summary(struct.get("description", ""))
            self.sections[struct["title"]] = Section(path, struct["title"], kind, about, fields)
            for name, field in fields.items():
                structs = self._structs(struct["properties"][name])
                for found in structs:
                    kind = _kind(found) if field.kinds else ""
                    due.append((field.path, found, kind, _shared(structs)))
        self._root = self.sections[root["title"]]

    def find(self, path: str) -> list[Section | ScenarioField]:
        """Return the fields and structs that a path names, which may begin anywhere.

        Raises
        ------
        UserError
            when there is none.
        """
        first, *rest = re.sub(r"\[\d*\]", "", path).split(".")
        found = self._starts(first)
        if not found:
            raise UserError(
                f"`{path}`: unknown field or kind; {did_you_mean(first, self._words())}"
            )
        for step in rest:
            following = [part for start in found for part in self._after(start, step)]
            if not following:
                known = {name for start in found for name in self._names(start)}
                raise UserError(
                    f"`{path}`: unknown field or kind `{step}`; {did_you_mean(step, known)}"
                    if known
                    else f"`{path}`: the field before `{step}` has no fields"
                )
            found = following
        return [part for at, part in enumerate(found) if part not in found[:at]]

    def of_field(self, field: ScenarioField) -> list[Section]:
        """Return the structs that a field's value can be."""
        return [self.sections[title] for title in field.structs]

    def _starts(self, step: str) -> list[Section | ScenarioField]:
        """Return what a path begins with: a field of the scenario, else structs, else fields."""
        if step in self._root.fields:
            return [self._root.fields[step]]
        sections = self.sections.values()
        return [s for s in sections if step in (_last(s), s.title)] or [
            s.fields[step] for s in sections if step in s.fields
        ]

    def _words(self) -> set[str]:
        sections = self.sections.values()
        return {name for s in sections for name in (_last(s), *s.fields)}

    def _after(self, start: Section | ScenarioField, step: str) -> list[Section | ScenarioField]:
        """Return what a step leads to: structs of a kind, or fields."""
        if isinstance(start, Section):
            return [start.fields[step]] if step in start.fields else []
        structs = self.of_field(start)
        if step in start.kinds:
            return [section for section in structs if section.kind == step]
        return [section.fields[step] for section in structs if step in section.fields]

    def _names(self, start: Section | ScenarioField) -> Iterator[str]:
        if isinstance(start, Section):
            return iter(start.fields)
        return chain(start.kinds, *(section.fields for section in self.of_field(start)))

    def _field(self, path: str, struct: Schema, node: Schema) -> ScenarioField:
        name = path.rpartition(".")[2]
        structs = self._structs(node)
        kinds = dict.fromkeys(filter(None, map(_kind, structs)))
        return ScenarioField(
            path,
            self._type(node),
            _unit(name),
            _default(struct, name),
            "; ".join(dict.fromkeys(_limits(node))),
            node.get("description", ""),
            tuple(found["title"] for found in structs),
            tuple(kinds) if len(structs) > 1 else (),
        )

    def _structs(self, node: Any) -> list[Schema]:
        """Return the structs that a file can have at a node; forms of one struct are joined."""
        found: dict[str, Schema] = {}
        for struct in self._forms(node):
            known = found.get(struct["title"], {"properties": {}})
            properties = known["properties"] | struct["properties"]
            found[struct["title"]] = struct | {"properties": properties}
        for resolved in RESOLVED:
            found.pop(resolved.__name__, None)
        return list(found.values())

    def _forms(self, node: Any) -> Iterator[Schema]:
        if not isinstance(node, dict):
            return
        if "$ref" in node:
            yield from self._forms(self._definitions[node["$ref"].rpartition("/")[2]])
        elif "properties" in node:
            yield node
        for part in _parts(node):
            yield from self._forms(part)

    def _type(self, node: Schema) -> str:
        """Return the type of a node in words."""
        if "$ref" in node:
            return str(node["$ref"].rpartition("/")[2])
        if "enum" in node:
            return _or(f"`{word}`" for word in node["enum"])
        if "discriminator" in node:
            return f"one of {len(node['anyOf'])} kinds"
        if "anyOf" in node:
            return _or(map(self._type, node["anyOf"]))
        if "prefixItems" in node:
            return f"[{', '.join(map(self._type, node['prefixItems']))}]"
        if "items" in node:
            return f"list of {self._type(node['items'])}"
        if "additionalProperties" in node and "title" not in node:
            values = node["additionalProperties"]
            return f"mapping to {self._type(values)}" if values else "mapping"
        return node.get("title") or _WORDS.get(node.get("type", ""), "any value")


def _parts(node: Schema) -> Iterator[Any]:
    """Yield the alternatives and entries of a node that is no struct."""
    if "properties" not in node:
        yield from node.get("anyOf", ())
        yield from node.get("prefixItems", ())
        yield from (node.get(key) for key in ("items", "additionalProperties"))


def _limits(node: Any) -> Iterator[str]:
    """Yield the limits of a value and of its entries."""
    if not isinstance(node, dict):
        return
    if bounds := [text.format(node[key]) for key, text in _BOUNDS.items() if key in node]:
        yield " ".join(bounds)
    if "prefixItems" not in node:
        yield from (text.format(node[key]) for key, text in _COUNTS.items() if key in node)
    if "pattern" in node:
        yield _PATTERNS.get(node["pattern"], f"matches `{node['pattern']}`")
    for part in _parts(node):
        yield from _limits(part)


def _kind(struct: Schema) -> str:
    """Return the kind that selects a struct; empty if it has none."""
    words = struct["properties"].get(TAG, {}).get("enum", ())
    return str(words[0]) if len(words) == 1 else ""


def _shared(structs: list[Schema]) -> frozenset[str]:
    """Return the fields that all kinds of a choice have in common; none without a choice."""
    if len(structs) == 1:
        return frozenset()
    first, *others = (struct["properties"] for struct in structs)
    return frozenset(
        name
        for name, node in first.items()
        if all(properties.get(name) == node for properties in others)
    )


def _default(struct: Schema, name: str) -> str:
    """Return the default of a field as in a file, or whether the field is required."""
    if name in struct.get("required", ()):
        return "required"
    if any(name in form["required"] for form in struct.get("anyOf", ()) if name != "datasheet"):
        return "required without a data sheet"
    node = struct["properties"][name]
    forms = [form for form in (node, *node.get("anyOf", ())) if "default" in form]
    if not forms:
        return ""
    value = forms[0]["default"]
    if isinstance(value, dict):
        return "its fields' defaults" if value else "{}"
    return "none" if value is None else json.dumps(value).strip('"') or '""'


def _path(*steps: str) -> str:
    return ".".join(filter(None, steps))


def _last(section: Section) -> str:
    return section.path.rpartition(".")[2] or section.title.lower()


def _unit(name: str) -> str:
    ends = [end for end in UNITS if f"_{name}".endswith(end)]
    return UNITS[max(ends, key=len)] if ends else ""


def _or(words: Iterable[str]) -> str:
    *others, last = dict.fromkeys(words)
    return f"{', '.join(others)} or {last}" if others else last
