# SPDX-License-Identifier: Apache-2.0
"""Code blocks of Markdown pages, fenced or indented."""

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

_FENCE = re.compile(r'(?P<indent> *)```(?P<language>[\w+#-]*)(?: title="(?P<title>[^"]*)")?')


@dataclass(frozen=True)
class Block:
    """A code block."""

    page: Path
    line: int
    """Line of its first line of code."""

    language: str
    """Of the fence: `sh`, `yaml`, `python`, `text`; "" for none, "indented" without a fence."""

    title: str
    text: str

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> list[Block]:
    """Return the code blocks of a page, in order.

    Raises
    ------
    ValueError
        if a fence does not end, or says what no test understands.
    """
    return list(_blocks(page, page.read_text(encoding="utf-8").splitlines()))


def _blocks(page: Path, lines: list[str]) -> Iterator[Block]:
    number = 0
    while number < len(lines):
        line = lines[number]
        if line.lstrip().startswith("```"):
            found = _FENCE.fullmatch(line)
            if found is None:
                raise ValueError(f"{page}:{number + 1}: unknown fence: {line}")
            end = number + 1
            while end < len(lines) and lines[end] != f"{found['indent']}```":
                end += 1
            if end == len(lines):
                raise ValueError(f"{page}:{number + 1}: the fence does not end")
            text = textwrap.dedent("\n".join(lines[number + 1 : end])) + "\n"
            yield Block(page, number + 2, found["language"], found["title"] or "", text)
            number = end + 1
        elif line.startswith("    ") and (number == 0 or not lines[number - 1].strip()):
            end = number
            while end < len(lines) and (lines[end].startswith("    ") or not lines[end].strip()):
                end += 1
            text = textwrap.dedent("\n".join(lines[number:end])).rstrip("\n") + "\n"
            yield Block(page, number + 1, "indented", "", text)
            number = end
        else:
            number += 1
