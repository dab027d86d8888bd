# SPDX-License-Identifier: Apache-2.0
"""A scenario with changed fields as the text of a file of its own, and the values of fields."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec
import yaml

from groundlink.scenario.schema import Scenario

from .document import DataPath, Document, SourceLine, read
from .overrides import FieldChange
from .scenario_files import SHIPPED, follow_references, scenario_file

REFERENCES = {"world": "worlds", "model": "vehicles", "route": "routes", "datasheet": "sensors"}
"""Folders of files that a field names without the suffix, by the name of the field."""


def value_of(field: str, file: str | Path, scenario: Scenario) -> Any:
    """Return the value of a field as its file states it, otherwise as loaded.

    Raises
    ------
    UserError
        when there is no such vehicle or element of a list.
    """
    change = FieldChange(field, None)
    document = read(scenario_file(file))
    stated = document.at(change.located(document))
    if stated is not None:
        return stated
    plain = msgspec.json.decode(msgspec.json.encode(scenario))
    loaded = Document(plain, {(): SourceLine(Path(file), 1)})
    return loaded.at(change.located(loaded))


def changed_text(file: str | Path, changes: Sequence[FieldChange], folder: Path) -> str:
    """Return a scenario with changes as YAML, for a file in another folder.

    Files that it names are named from that folder. A file of which a field is changed is included.

    Raises
    ------
    UserError
        when there is no such field.
    """
    document, followed = read(scenario_file(file)), read(scenario_file(file))
    late = [change for change in changes if not change.apply_where_written(document)]
    for change in changes:
        change.apply_where_written(followed)
    follow_references(followed)
    for change in late:
        change.apply(followed)
        _include(document, followed, change.located(followed))
    value = _moved(document, (), folder)
    text: str = yaml.safe_dump(value, sort_keys=False, default_flow_style=None, width=100)
    return text


def _include(document: Document, followed: Document, path: DataPath) -> None:
    """Take the part that holds a path from the document whose references were followed."""
    ends = (n for n in range(1, len(path)) if not isinstance(document.at(path[:n]), dict | list))
    if (end := next(ends, None)) is None:  # an earlier change has included it
        return
    part = path[:end]
    marks = {mark[end:]: line for mark, line in followed.marks.items() if mark[:end] == part}
    document.put(part, Document(followed.at(part), {(): followed.mark(part)} | marks))


def _moved(document: Document, path: DataPath, folder: Path) -> Any:
    """Return the value at a path with the files that it names, named from another folder."""
    value = document.at(path)
    if isinstance(value, dict):
        return {name: _moved(document, (*path, name), folder) for name in value}
    if isinstance(value, list):
        return [_moved(document, (*path, index), folder) for index in range(len(value))]
    if not isinstance(value, str):
        return value
    beside = document.mark(path).file.parent
    kind = REFERENCES.get(str(path[-1]))
    name = value if Path(value).suffix or kind is None else f"{kind}/{value}.yaml"
    if beside == SHIPPED or not (beside / name).is_file():
        return value
    return os.path.relpath(beside / name, folder)
