# SPDX-License-Identifier: Apache-2.0
"""Descriptions of the fields of structs, read from the docstrings below the fields.

Source files are read when a schema is generated, never when a scenario is loaded.
"""

import ast
import inspect
import sys
from functools import cache
from itertools import pairwise

import msgspec


def field_descriptions(struct: type[msgspec.Struct]) -> dict[str, str]:
    """Return the description of each documented field, by its key in files.

    A field without a docstring has that of the base class that declares it, too. Without a source
    file there are no descriptions.
    """
    texts: dict[str, str] = {}
    for owner in reversed(struct.__mro__):
        texts |= _docstrings(owner.__module__).get(owner.__qualname__, {})
    fields = msgspec.structs.fields(struct)
    return {field.encode_name: texts[field.name] for field in fields if field.name in texts}


def summary(text: str) -> str:
    """Return the first paragraph of a docstring as one line."""
    return " ".join(text.strip().partition("\n\n")[0].split())


@cache
def _docstrings(module: str) -> dict[str, dict[str, str]]:
    """Return the docstrings of the annotated fields of each class at the top of a module."""
    try:
        source = inspect.getsource(sys.modules[module])
    except (KeyError, OSError, TypeError):  # Made by a program, compiled, or without a file.
        return {}
    classes = (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef))
    return {node.name: _below_fields(node) for node in classes}


def _below_fields(node: ast.ClassDef) -> dict[str, str]:
    texts = {}
    for field, below in pairwise(node.body):
        match field, below:
            case (
                ast.AnnAssign(target=ast.Name(id=name)),
                ast.Expr(value=ast.Constant(value=str(text))),
            ):
                texts[name] = " ".join(text.split())
    return texts
