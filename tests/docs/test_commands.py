# SPDX-License-Identifier: Apache-2.0
"""Every command line that a document shows has commands, options and modules that exist."""

import contextlib
import importlib.util
import io
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from groundlink.cli.commands import parser

from .blocks import DOCS, ROOT, blocks

FOLDERS = (
    DOCS,
    *(ROOT / name for name in ("conformance", "deploy", "examples", "ros", "udp-bridge")),
)
PAGES = sorted(
    {*ROOT.glob("*.md"), *(page for folder in FOLDERS for page in folder.rglob("*.md"))}
    - {ROOT / "CHANGELOG.md", DOCS / "reference" / "commands.md"}
)
"""All but the history, and the page that the parser itself writes."""

SHELL = ("", "sh", "bash", "console", "text", "indented")
"""Languages of blocks that may have a command; in others, `groundlink` is a name."""

NUMBERS = {"S", "F", "N", "P", "M/S", "RAD/S"}
"""Words of usage lines for a number."""

IN_TEXT = "in the text"

_COMMAND = re.compile(r"(?:^|.*/)groundlink$")
_NAMES_ONLY = ("the following arguments are required", "expected one argument")
"""What a mention in the text may lack: `groundlink report` names the command."""


def command_lines(page: Path) -> Iterator[tuple[str, str]]:
    """Return the command lines of a page's blocks and of its text, each with its place."""
    for block in blocks(page):
        if block.language in SHELL:
            for number, line in enumerate(re.sub(r"\\\n", "  ", block.text).splitlines()):
                yield f"{page.relative_to(ROOT)}:{block.line + number}", line.removeprefix("$ ")
    text = re.sub(r"^ *```.*?^ *```$", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    for span in re.findall(r"`([^`]+)`", text):
        yield f"{page.relative_to(ROOT)}: {IN_TEXT}", " ".join(span.split())


def commands_in(line: str) -> Iterator[list[str]]:
    """Return the simple commands of a line as words, without variables, pipes and redirections."""
    try:
        lexer = shlex.shlex(line, posix=True, punctuation_chars="|&;<>")
        lexer.whitespace_split = True
        words = list(lexer)
    except ValueError:  # An apostrophe of a text that is no command.
        return
    command: list[str] = []
    is_target = False
    for word in [*words, ";"]:
        if set(word) <= set("|&;"):
            yield command
            command = []
        elif set(word) <= set("<>"):
            is_target = True
        elif is_target:
            is_target = False
        elif command or not re.match(r"[A-Z_]+=", word):
            command.append(word)


def groundlink_commands(page: Path) -> list[tuple[str, list[str]]]:
    """Return the words behind `groundlink` of each command of it, with its place.

    Brackets around optional words are left out, and numbers stand for `NUMBERS`.
    """
    found = []
    for place, line in command_lines(page):
        optional = re.sub(r"\[(-[^]]*|[A-Z]+)\]", r"\1", line)
        for words in commands_in(optional):
            if words and _COMMAND.match(words[0]) and is_command_line(words[1:]):
                found.append((place, ["1" if word in NUMBERS else word for word in words[1:]]))
    return found


def is_command_line(words: list[str]) -> bool:
    """Return whether words are more than the beginning of a sentence or of an output."""
    return all(re.fullmatch(r"[\w./*,:=@{}~+-]+(?:\|[\w.]+)*", word) for word in words)


def mistake(words: list[str]) -> str | None:
    """Return what the parser says to a command line, if it refuses it."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            parser().parse_args(words)
        except SystemExit as end:
            return said.getvalue().strip().splitlines()[-1] if end.code else None
    return None


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_are_understood(page: Path) -> None:
    refused = {}
    for place, words in groundlink_commands(page):
        said = mistake(words)
        is_mention = place.endswith(IN_TEXT) and any(text in str(said) for text in _NAMES_ONLY)
        if said is not None and not is_mention:
            refused[f"{place}: groundlink {shlex.join(words)}"] = said
    assert refused == {}


def test_commands_are_found() -> None:
    found = [words[0] for page in PAGES for _, words in groundlink_commands(page) if words]
    assert len(found) > 100
    assert len(set(found)) > 20


@pytest.mark.parametrize("words", ["fly", "up", "up x.yaml --wings 2", "step many"])
def test_mistakes_are_refused(words: str) -> None:
    assert mistake(words.split()) is not None


def test_modules_exist() -> None:
    """The module behind `python -m` in every page can be found."""
    missing = []
    for page in PAGES:
        for place, line in command_lines(page):
            for words in commands_in(line):
                if len(words) > 2 and words[0].rpartition("/")[2] == "python" and words[1] == "-m":
                    if re.fullmatch(r"[a-z]\w*(\.\w+)*", words[2]) and not _exists(words[2]):
                        missing.append(f"{place}: {words[2]}")
    assert missing == []


def _exists(module: str) -> bool:
    try:
        return importlib.util.find_spec(module) is not None
    except ModuleNotFoundError:
        return False
