# SPDX-License-Identifier: Apache-2.0
"""Summary page `experiments.md` of all tables and figures in an output folder.

Written anew after each experiment; docs/experiments.md explains the results.
"""

from pathlib import Path

from experiments.table import EXPERIMENTS

from .page import text_of


def write_report(out: Path) -> Path:
    """Write the page of a folder; return its file."""
    parts = ["# Experiments"]
    for name, experiment in EXPERIMENTS.items():
        tables = _files(out / "tables", name, ".csv")
        figures = _files(out / "figures", name, ".png")
        if not tables and not figures:
            continue
        parts += [f"## {name}", experiment.what]
        parts += [text_of(file) for file in tables]
        parts += [f"![{file.stem}]({file.relative_to(out)})" for file in figures]
    page = out / "experiments.md"
    page.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return page


def _files(folder: Path, name: str, ending: str) -> list[Path]:
    """Return the files of one experiment: NAME and NAME_MORE."""
    found = sorted(folder.glob(f"{name}*{ending}"))
    return [file for file in found if file.stem == name or file.stem.startswith(f"{name}_")]
