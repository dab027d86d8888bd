# SPDX-License-Identifier: Apache-2.0
"""Every default of a scenario, pinned: a change of one is a change of all scenarios without it.

After a change on purpose: `python -m tests.groundlink.scenario.test_defaults` writes the table
anew, and its difference says what changed for users.
"""

import json
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec
from msgspec import inspect

from groundlink.scenario.schema import Scenario

TABLE = Path(__file__).with_name("defaults.txt")


def structs(found: inspect.Type, known: set[type]) -> Iterator[inspect.StructType]:
    """Yield every structure that a type can hold, once."""
    match found:
        case inspect.StructType() if found.cls not in known:
            known.add(found.cls)
            yield found
            for field in found.fields:
                yield from structs(field.type, known)
        case inspect.UnionType():
            for member in found.types:
                yield from structs(member, known)
        case inspect.DictType():
            yield from structs(found.value_type, known)
        case inspect.VarTupleType() | inspect.ListType():
            yield from structs(found.item_type, known)
        case inspect.TupleType():
            for member in found.item_types:
                yield from structs(member, known)


def value(field: inspect.Field) -> Any:
    """Return a default as plain data; a structure of defaults alone by its name."""
    made = field.default if field.default_factory is msgspec.NODEFAULT else field.default_factory()
    if made is msgspec.NODEFAULT:
        return None  # Left out of messages and hashes.
    with suppress(TypeError):
        if isinstance(made, msgspec.Struct) and made == type(made)():
            return f"{type(made).__name__}()"
    return msgspec.to_builtins(made)


def defaults() -> str:
    """Return a line for each field that may be left out."""
    rows = []
    for struct in structs(inspect.type_info(Scenario), set()):
        for field in struct.fields:
            if not field.required:
                rows.append(
                    f"{struct.cls.__name__}.{field.encode_name}: {json.dumps(value(field))}"
                )
    return "\n".join(sorted(rows)) + "\n"


def test_every_default_is_what_it_was() -> None:
    assert defaults() == TABLE.read_text(encoding="utf-8"), "on purpose? see the module's docstring"


if __name__ == "__main__":
    TABLE.write_text(defaults(), encoding="utf-8")
