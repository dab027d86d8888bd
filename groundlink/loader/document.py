# SPDX-License-Identifier: Apache-2.0
"""YAML documents: plain data with the file and line of every value.

A path is a tuple of keys and indices. A value included from another file keeps that file's lines.
"""

from contextlib import suppress
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path
from typing import Any

import yaml

from groundlink.core.errors import UserError

DataPath = tuple[str | int, ...]

MAX_DEPTH = 50
"""Maximum length of a path."""

MAX_VALUES = 100_000
"""Maximum number of values in a file with its aliases expanded."""


class ScenarioError(UserError):
    """A mistake in a scenario, with file, line and field."""


@dataclass(frozen=True)
class SourceLine:
    """A line of a file."""

    file: Path
    line: int

    def __str__(self) -> str:
        return f"{self.file}:{self.line}"


@dataclass
class Document:
    """Plain data with the source line of every value."""

    value: Any
    marks: dict[DataPath, SourceLine] = field(default_factory=dict)

    def mark(self, path: DataPath) -> SourceLine:
        """Return the source line of the value at `path`, or of its nearest parent."""
        while path not in self.marks:
            path = path[:-1]
        return self.marks[path]

    def at(self, path: DataPath) -> Any:
        """Return the value at `path`, or None where there is none."""
        value = self.value
        for step in path:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def alone(self, path: DataPath) -> "Document":
        """Return the value at `path` as a document of its own, under its last key."""
        name = path[-1]
        part = Document({name: self.at(path)}, {(): self.mark(path)})
        for inner, mark in self.marks.items():
            if inner[: len(path)] == path:
                part.marks[(name, *inner[len(path) :])] = mark
        return part

    def put(self, path: DataPath, part: "Document") -> None:
        """Replace the value at `path` by another document and its marks."""
        around = self.at(path[:-1])
        around[path[-1]] = part.value
        self.marks.update({path + inner: mark for inner, mark in part.marks.items()})

    def remove(self, path: DataPath) -> None:
        """Remove an element of a list; those after it move up."""
        here, index = path[:-1], path[-1]
        listed = self.at(here)
        kept = [i for i in range(len(listed)) if i != index]
        parts = [self.alone((*here, i)) for i in kept]
        self.marks = {p: m for p, m in self.marks.items() if p[: len(here)] != here or p == here}
        listed[:] = [listed[i] for i in kept]
        for i, part in enumerate(parts):
            self.marks |= {
                (*here, i, *inner[1:]): mark for inner, mark in part.marks.items() if inner
            }


def read(file: Path) -> Document:
    """Return the data of a YAML file.

    Raises
    ------
    ScenarioError
        when the file is missing, unreadable or not YAML, or when a key stands twice.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"{file}: {(error.strerror or str(error)).lower()}") from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{file}: not UTF-8 text ({error.reason})") from None
    return parse(text, file)


def parse(text: str, file: Path) -> Document:
    """Return the data of a YAML text, which stands in a file or is named like one.

    Raises
    ------
    ScenarioError
        when it is not YAML, or when a key stands twice.
    """
    try:
        node = _compose(text, file)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"{file}:{mark.line + 1}" if mark else str(file)
        raise ScenarioError(f"{where}: not valid YAML: {error.problem}") from None
    except yaml.YAMLError as error:
        raise ScenarioError(f"{file}: not valid YAML: {' '.join(str(error).split())}") from None
    if node is None:
        raise ScenarioError(f"{file}: the file is empty")
    document = Document(None)
    document.value = _plain(node, (), document, file)
    return document


class _LimitedDepth:
    """Part of a composer: limits the depth, since PyYAML composes nodes by recursion."""

    file: Path
    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Compose the next node and all inside it."""
        if self.depth > MAX_DEPTH:
            event = self.peek_event()  # type: ignore[attr-defined]
            raise _too_deep(SourceLine(self.file, event.start_mark.line + 1))
        self.depth += 1
        node: yaml.Node | None = super().compose_node(parent, index)  # type: ignore[misc]
        self.depth -= 1
        return node


class _Composer(_LimitedDepth, yaml.SafeLoader):
    """Composer in Python, whose errors say most."""


_LIBYAML: Any = getattr(yaml, "CSafeLoader", None)
"""None where PyYAML was built without LibYAML."""


class _FastComposer(_LimitedDepth, yaml.composer.Composer, _LIBYAML or object):  # type: ignore[misc]
    """Composer of what LibYAML parses, in a third of the time."""

    def __init__(self, text: str) -> None:
        _LIBYAML.__init__(self, text)
        yaml.composer.Composer.__init__(self)


def _compose(text: str, file: Path) -> yaml.Node | None:
    if _LIBYAML is not None and "\t" not in text:  # PyYAML refuses tabs that LibYAML takes
        with suppress(yaml.YAMLError):
            return _composed(_FastComposer(text), file)
    return _composed(_Composer(text), file)


def _composed(composer: _Composer | _FastComposer, file: Path) -> yaml.Node | None:
    composer.file = file
    try:
        return composer.get_single_node()
    finally:
        composer.dispose()


def _too_deep(mark: SourceLine) -> ScenarioError:
    return ScenarioError(f"{mark}: nested more than {MAX_DEPTH} deep; does an alias hold itself?")


def _plain(node: yaml.Node, path: DataPath, document: Document, file: Path) -> Any:
    """Convert a YAML node into plain data and record its source line."""
    mark = SourceLine(file, node.start_mark.line + 1)
    if len(path) > MAX_DEPTH:
        raise _too_deep(mark)
    document.marks[path] = mark
    if len(document.marks) > MAX_VALUES:
        raise ScenarioError(
            f"{mark}: the file has more than {MAX_VALUES} values, those of aliases included; "
            "expected fewer. Fix: write out only what is needed, without aliases of aliases"
        )
    if isinstance(node, yaml.SequenceNode):
        return [_plain(n, (*path, i), document, file) for i, n in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode):
        result: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value)
            line = key_node.start_mark.line + 1
            if key in result:
                raise ScenarioError(f"{file}:{line}: `{key}`: duplicate key. Fix: keep one")
            result[key] = _plain(value_node, (*path, key), document, file)
            document.marks[(*path, key)] = SourceLine(file, line)
        return result
    if path[-1:] == ("kind",):
        return str(node.value)  # always a string: YAML 1.1 reads `off` as false
    try:  # into int, float, bool, str or None
        value = yaml.constructor.SafeConstructor().construct_object(node, deep=True)
    except (yaml.YAMLError, ValueError) as error:
        problem = getattr(error, "problem", None) or str(error)
        raise ScenarioError(f"{mark}: cannot read this value: {problem}") from None
    if isinstance(value, float) and not isfinite(value):
        name = next((step for step in reversed(path) if isinstance(step, str)), "value")
        raise ScenarioError(f"{mark}: `{name}` is {value}; expected a finite number")
    return value
