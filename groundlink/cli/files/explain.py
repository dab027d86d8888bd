# SPDX-License-Identifier: Apache-2.0
"""`groundlink explain PATH`: what a field of a scenario means, with unit, default and range."""

import argparse
import json
import textwrap
from collections.abc import Iterable, Iterator
from typing import Any

from groundlink.cli import Subparsers
from groundlink.loader.field_reference import FieldReference, ScenarioField, Section
from groundlink.loader.json_schema import json_schema

WIDTH = 80
"""Width of the text."""

FACTS = ("type", "unit", "default", "range")


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "explain", help="explain a field of a scenario: meaning, unit, default, range"
    )
    parser.add_argument(
        "path", help="field or kind, as in `lidar.dropout`, `time.mode` or `vehicles.sensors`"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(command=explain)


def explain(options: argparse.Namespace) -> int:
    """Print every field and struct that the path names."""
    reference = FieldReference(json_schema("scenario"))
    found = reference.find(options.path)
    if options.json:
        print(json.dumps([_facts(reference, part) for part in found], indent=2))
    else:
        print("\n\n".join("\n".join(lines(reference, part)) for part in found))
    return 0


def _facts(reference: FieldReference, part: Section | ScenarioField) -> dict[str, Any]:
    """Return a field with all that it can hold, or a struct with its fields."""
    if isinstance(part, Section):
        fields = [_facts_of_field(field) for field in part.fields.values()]
        return {"path": part.path, "description": part.description, "fields": fields}
    structs = [_facts(reference, section) for section in reference.of_field(part)]
    return _facts_of_field(part) | {"structs": structs}


def _facts_of_field(field: ScenarioField) -> dict[str, Any]:
    facts = {name: getattr(field, name) for name in ("path", *FACTS, "description")}
    return facts | {"kinds": field.kinds}


def lines(reference: FieldReference, part: Section | ScenarioField) -> Iterator[str]:
    """Yield the lines that explain a field or a struct."""
    yield part.path or part.title.lower() if isinstance(part, Section) else part.path
    yield from _wrapped(part.description, "  ")
    if isinstance(part, Section):
        yield ""
        yield from _table((name, field) for name, field in part.fields.items())
        return
    for name in FACTS:
        if fact := getattr(part, name):
            yield from _wrapped(fact, f"  {name:8} ")
    structs = reference.of_field(part)
    if part.kinds:
        yield ""
        yield from _aligned((s.kind or s.title, [s.description]) for s in structs)
    elif structs:
        yield ""
        yield from _table(structs[0].fields.items())


def _table(fields: Iterable[tuple[str, ScenarioField]]) -> Iterator[str]:
    """Yield a table of fields: the name, then the facts and the meaning."""
    yield from _aligned((name, [_short(field), field.description]) for name, field in fields)


def _short(field: ScenarioField) -> str:
    """Return type, unit, range and default of a field as one line."""
    default = textwrap.shorten(field.default, 40, placeholder=" ...")
    if default and not default.startswith("required"):
        default = f"default {default}"
    unit = f"{field.type}, {field.unit}" if field.unit else field.type
    return "; ".join(filter(None, (unit, field.range, default)))


def _aligned(rows: Iterable[tuple[str, list[str]]]) -> Iterator[str]:
    """Yield rows of a name and texts, with the texts in one column."""
    rows = list(rows)
    indent = max(len(name) for name, _ in rows) + 4
    for name, texts in rows:
        head = f"  {name}"
        for text in texts:
            yield from _wrapped(text, f"{head:{indent}}")
            head = ""


def _wrapped(text: str, head: str) -> list[str]:
    """Return a text that begins behind `head`, wrapped in one column."""
    return textwrap.wrap(
        text,
        WIDTH,
        initial_indent=head,
        subsequent_indent=" " * len(head),
        break_on_hyphens=False,
    )
