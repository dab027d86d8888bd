# SPDX-License-Identifier: Apache-2.0
"""Writes the JSON schemas that ship for editors: ``python -m tools.json_schemas``.

The schema of scenarios holds all definitions; the others refer to it. A test compares the files.
"""

import json
from pathlib import Path

from groundlink.loader.json_schema import DIALECT, KINDS, Schema, json_schema
from groundlink.loader.scenario_files import SHIPPED

FOLDER = SHIPPED / "schemas"
WHOLE = "scenario"


def files() -> dict[Path, str]:
    """Return the content of each file."""
    return {FOLDER / f"{kind}.json": json.dumps(_shipped(kind), indent=1) + "\n" for kind in KINDS}


def _shipped(kind: str) -> Schema:
    whole = json_schema(kind)
    if kind == WHOLE:
        return whole
    references = [{"$ref": f"{WHOLE}.json#/$defs/{name}"} for name in KINDS[kind]]
    return {"$schema": DIALECT, "title": whole["title"], "anyOf": references}


def main() -> None:
    """Write the files."""
    FOLDER.mkdir(exist_ok=True)
    for file, text in files().items():
        file.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
