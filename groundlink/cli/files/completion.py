# SPDX-License-Identifier: Apache-2.0
"""`groundlink completion SHELL`: print the script that completes commands in a shell.

The script holds all commands, options and names, so a TAB starts no Python. Print it again after an
update. What an argument can be follows from its metavar, or from its name if it has none.
"""

import argparse
import re
import shlex
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

from groundlink.cli import Subparsers
from groundlink.episode.fault_messages import CLEAR
from groundlink.importing import heightmaps, mesh_files
from groundlink.loader.additions import KINDS as ADDITIONS
from groundlink.loader.datasheets import datasheet_files
from groundlink.loader.field_reference import FieldReference
from groundlink.loader.json_schema import json_schema
from groundlink.loader.partial_scenario import FOLDERS
from groundlink.loader.scenario_files import SHIPPED
from groundlink.scenario.faults import KINDS as FAULTS
from groundlink.scenario.route import FIGURES

SHELLS = ("bash", "zsh", "fish")

RUNS = r"ps -eo args= | sed -n 's/.*-m [s]ervices.physics .*--run \([^ ]*\).*/\1/p'"
"""Shell command that prints the runs of this machine. A query of the bus would take a second."""


class Words(NamedTuple):
    """What an argument can be."""

    names: Callable[[], Iterable[str]] = tuple
    command: str = ""
    """Shell command that prints more names."""

    files: tuple[str, ...] = ()
    """Patterns of files. Folders are completed, too."""

    is_folder: bool = False


def _shipped(*folders: str) -> list[str]:
    """Return the names of shipped files."""
    return [file.stem for folder in folders for file in (SHIPPED / folder).glob("*.yaml")]


def _fields() -> Iterator[str]:
    """Yield structs and fields, such as `lidar` and `lidar.dropout`."""
    for section in FieldReference(json_schema("scenario")).sections.values():
        struct = section.path.rpartition(".")[2]
        if struct:
            yield struct
        for name in section.fields:
            yield f"{struct}.{name}" if struct else name


SCENARIOS = Words(lambda: _shipped(""), files=("*.yaml",))

WORDS = {
    "scenario": SCENARIOS,
    "SCENARIO": SCENARIOS,
    "VALUE|SCENARIO|REV": SCENARIOS,
    "WORLD|VEHICLE|SCENARIO": Words(lambda: _shipped(*FOLDERS), files=("*.yaml",)),
    "WORLD|SCENARIO": Words(lambda: _shipped("worlds", ""), files=("*.yaml",)),
    "VEHICLE|FILE.yaml": Words(lambda: _shipped("vehicles"), files=("*.yaml",)),
    "FILE.yaml|KIND": Words(lambda: ADDITIONS, files=("*.yaml",)),
    "FILE.yaml|FIGURE": Words(lambda: FIGURES, files=("*.yaml",)),
    "sheet": Words(lambda: (file.stem for file in datasheet_files()), files=("*.yaml",)),
    "run": Words(command=RUNS),
    "kind": Words(lambda: [*FAULTS, CLEAR]),
    "path": Words(_fields),
    "FIELD|FIELD=VALUE,...": Words(_fields),
    "file": Words(files=tuple(f"*{end}" for end in (*heightmaps.FORMATS, *mesh_files.FORMATS))),
    "folder": Words(is_folder=True),
    "FOLDER": Words(is_folder=True),
    "DIR": Words(is_folder=True),
    "FILE": Words(files=("*",)),
    "DEVICE": Words(files=("*",)),
    "RUN.mcap": Words(files=("*.mcap",)),
    "OTHER.mcap": Words(files=("*.mcap",)),
    "RUN.bag": Words(files=("*.bag",)),
    "FILE.json": Words(files=("*.json",)),
    "FILE.rrd": Words(files=("*.rrd",)),
    "REPORT.html": Words(files=("*.html",)),
    "TRIALS.html": Words(files=("*.html",)),
    "RECORDING": Words(files=("*.mcap", "*.db3", "*.bag", "*.pcap", "*.osf")),
    "SHEET.yaml": Words(files=("*.yaml",)),
    "WORLD.yaml": Words(files=("*.yaml",)),
    "MAP.yaml": Words(files=("*.yaml",)),
    "FILE.png|FILE.jpg": Words(files=("*.png", "*.jpg")),
}
"""By the metavar of an argument, or its name."""


def add_parser(subparsers: Subparsers) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser(
        "completion",
        help="print the script for completion by TAB in a shell",
        description="Print the script for completion by TAB. In this shell: "
        'eval "$(groundlink completion bash)". For every shell, save it where the shell finds it: '
        "~/.local/share/bash-completion/completions/groundlink for bash, a file _groundlink in a "
        "folder of $fpath for zsh, ~/.config/fish/completions/groundlink.fish for fish.",
    )
    parser.add_argument("shell", choices=SHELLS, help="shell that reads the script")
    parser.set_defaults(command=completion)


def completion(options: argparse.Namespace) -> int:
    """Print the script."""
    import shtab

    from groundlink.cli.commands import parser

    groundlink = parser()
    functions = {}
    for action in arguments(groundlink):
        key = key_of(action)
        if key not in WORDS:
            continue
        words = WORDS[key]
        if words.is_folder:
            action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
            continue
        # shtab has bash quote file names where a function's name has `_file`.
        name = f"_groundlink{'_file' if words.files else ''}_{re.sub('[^a-zA-Z]+', '_', key)}"
        functions[name] = WRITERS[options.shell](name, words)
        call = f"({name})" if options.shell == "fish" else name
        action.complete = {options.shell: call}  # type: ignore[attr-defined]
    print(shtab.complete(groundlink, options.shell, preamble="\n".join(functions.values())))
    return 0


def arguments(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the arguments with a value, of a parser and of the commands below it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from arguments(below)
        elif action.nargs != 0 and not action.choices:
            yield action


def key_of(action: argparse.Action) -> str:
    """Return the key of an argument in `WORDS`."""
    return action.metavar if isinstance(action.metavar, str) else action.dest


def _bash(name: str, words: Words) -> str:
    lines = [f"compgen -W {_listed(words)} -- $1"]
    lines += [f"compgen -f -X {shlex.quote('!' + pattern)} -- $1" for pattern in words.files]
    lines += ["compgen -d -- $1"] if words.files else []
    return _function(f"{name}() {{", lines, "}")


def _zsh(name: str, words: Words) -> str:
    lines = [f"local -a names; names=(${{(z)$(echo {_listed(words)})}}); compadd -a names"]
    lines += [f"_files -g {shlex.quote('|'.join(words.files))}"] if words.files else []
    return _function(f"{name}() {{", lines, "}")


def _fish(name: str, words: Words) -> str:
    names = shlex.join(sorted(words.names()))
    lines = [f"printf '%s\\n' {names}"] if names else []
    lines += [words.command] if words.command else []
    paths = "__fish_complete_path (commandline -ct)"
    lines += [f"{paths} | string match -e -- {shlex.quote(end)}" for end in words.files]
    lines += [f"{paths} | string match -e -- '*/'"] if words.files else []
    return _function(f"function {name}", lines, "end")


WRITERS = {"bash": _bash, "zsh": _zsh, "fish": _fish}
"""Functions that return a shell's function, which prints or adds the words of an argument."""


def _listed(words: Words) -> str:
    """Return the names as one quoted word of bash and zsh."""
    names = " ".join(sorted(words.names()))
    return f'"{names} $({words.command})"' if words.command else f'"{names}"'


def _function(head: str, lines: list[str], end: str) -> str:
    return "\n".join([head, *(f"  {line}" for line in lines), end])
