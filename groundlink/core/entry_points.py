# SPDX-License-Identifier: Apache-2.0
"""Entry points of installed distributions, read without `importlib.metadata`.

That module imports `email` and `zipfile`, which takes a tenth of the start of a sensor, and each
process of a run reads the entry points.
"""

import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

_METADATA_FILES = {".dist-info": "METADATA", ".egg-info": "PKG-INFO"}
"""File with the name of a distribution, by the ending of its metadata folder."""


class InstalledEntry(NamedTuple):
    """Entry point of an installed distribution."""

    name: str
    value: str
    """Reference to an object, such as `module:object`."""

    distribution: str
    """Name of the distribution."""


def entry_points(group: str) -> list[InstalledEntry]:
    """Return the entry points of a group.

    Of several distributions with the same name, the first on `sys.path` counts.
    """
    folders: dict[str, Path] = {}
    for folder in sys.path:
        for info in _metadata_folders(folder or "."):
            name = re.sub(r"[-_.]+", "_", info.stem.partition("-")[0]).lower()
            folders.setdefault(name, info)
    return [
        InstalledEntry(name, value, _distribution(info))
        for info in folders.values()
        for name, value in _lines(info / "entry_points.txt", group)
    ]


def _metadata_folders(folder: str) -> list[Path]:
    try:
        names = os.listdir(folder)
    except OSError:  # `sys.path` also names folders that do not exist, and archives.
        return []
    return [Path(folder, name) for name in names if name.endswith(tuple(_METADATA_FILES))]


def _lines(file: Path, group: str) -> Iterator[tuple[str, str]]:
    """Yield name and value of each line of a section."""
    try:
        text = file.read_text(encoding="utf-8")
    except OSError:  # Most distributions have no entry points; some have a file as metadata.
        return
    section = ""
    for line in map(str.strip, text.splitlines()):
        if line.startswith("["):
            section = line.strip("[]")
        elif section == group and "=" in line and not line.startswith("#"):
            name, _, value = line.partition("=")
            yield name.strip(), value.strip()


def _distribution(info: Path) -> str:
    with (info / _METADATA_FILES[info.suffix]).open(encoding="utf-8") as headers:
        return next(line[5:].strip() for line in headers if line.startswith("Name:"))
