# SPDX-License-Identifier: Apache-2.0
"""Summary page of an output folder, and the tables of docs/explanation/experiments.md.

`python -m experiments.output.page` updates docs/explanation/experiments.md.

Each table of the page is generated from the CSV file beside it, between the marks `<!-- NAME -->`
and `<!-- end of NAME -->`. Tables and figures that the page shows are copied into
docs/explanation/experiments.
"""

import argparse
import csv
import math
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from experiments.estimation.evaluation import Evaluation, median, read_csv
from experiments.experiment import OUT
from experiments.recording.setups import ROOT
from experiments.table import EXPERIMENTS

PAGE = ROOT / "docs" / "explanation" / "experiments.md"
KEPT = ROOT / "docs" / "explanation" / "experiments"
"""Tables and figures that the page shows."""

COLORS = 64
"""Colors of a kept figure."""


def table(name: str, results: Sequence[Evaluation]) -> str:
    """Return the table of an experiment with its command."""
    return "\n".join([f"`python -m experiments {name}`", "", *table_of(results)])


def table_of(results: Sequence[Evaluation]) -> list[str]:
    """Return a line for each program and case, medians over seeds."""
    far = any(result.over_100_m for result in results)
    windows = ["over 100 m, median", "of each seed"] if far else []
    head = ["program", "ATE, median", "of each seed", *windows]
    head += ["start to end, median", "way", "limit", "took"]
    lines = [_line(head), "|" + "---|" * len(head)]
    groups: dict[tuple[str, str], list[Evaluation]] = {}
    for result in results:
        groups.setdefault((result.program, result.case), []).append(result)
    for (program, case), group in groups.items():
        cells = [f"{program}, {case}" if case else program, _length(median(group))]
        cells.append(", ".join(_length(result.ate_m) for result in group))
        if far:
            cells.append(_share(median(group, "over_100_m")))
            cells.append(", ".join(_share(result.over_100_m) for result in group))
        cells += [_length(median(group, "start_to_end_m")), f"{median(group, 'way_m'):.1f} m"]
        cells += [_limit(group[0]), f"{median(group, 'took_s'):.0f} s"]
        lines.append(_line(cells))
    return lines


def listing(file: Path) -> str:
    """Return a table of another kind as it stands in its file."""
    with file.open(encoding="utf-8", newline="") as stream:
        head, *rows = csv.reader(stream)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(map(_line, lines))


def text_of(file: Path) -> str:
    """Return what the page shows of a table."""
    with file.open(encoding="utf-8", newline="") as stream:
        head = next(csv.reader(stream))
    if "ate_m" in head:
        return table(file.stem, read_csv(file))
    return listing(file)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _limit(result: Evaluation) -> str:
    """Return the limit of an ATE or of a relative error."""
    if result.limit_over_100_m:
        return f"{100 * result.limit_over_100_m:g} % over 100 m"
    return _length(result.limit_m) if result.limit_m else "-"


def _share(share: float) -> str:
    return f"{100 * share:.2f} %" if share else "-"


def _length(meters: float) -> str:
    """Return a length as people read it."""
    if math.isinf(meters):
        return "lost"
    return f"{meters:.2f} m" if meters >= 1 else f"{100 * meters:.2f} cm"


def with_table(page: str, name: str, text: str) -> str:
    """Return a page with another table between its marks.

    Raises
    ------
    ValueError
        when the page has no such marks.
    """
    begin, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if not pattern.search(page):
        raise ValueError(f"{PAGE}: marks {begin} and {end} not found")
    return pattern.sub(lambda _: f"{begin}\n{text}\n{end}", page)


def write_report(out: Path) -> Path:
    """Write `experiments.md` of all tables and figures in an output folder; return its path."""
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


def keep(file: Path, folder: Path) -> None:
    """Copy a table or a figure into a folder, figures with a palette: a third of the bytes."""
    if file.suffix != ".png":
        shutil.copy(file, folder)
        return
    with Image.open(file) as picture:
        small = picture.convert("RGB").quantize(COLORS, method=Image.Quantize.MAXCOVERAGE, kmeans=2)
    small.save(folder / file.name, optimize=True)


def _files(folder: Path, name: str, ending: str) -> list[Path]:
    """Return the files of one experiment: NAME and NAME_MORE."""
    found = sorted(folder.glob(f"{name}*{ending}"))
    return [file for file in found if file.stem == name or file.stem.startswith(f"{name}_")]


def main(arguments: Sequence[str]) -> int:
    """Take over what was measured."""
    parser = argparse.ArgumentParser(prog="python -m experiments.output.page")
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args(arguments)
    KEPT.mkdir(exist_ok=True)
    page = PAGE.read_text(encoding="utf-8")
    tables, figures = options.out / "tables", options.out / "figures"
    for file in (*sorted(tables.glob("*.csv")), *sorted(figures.glob("*.png"))):
        if f"<!-- {file.stem} -->" in page or f"({KEPT.name}/{file.name})" in page:
            keep(file, KEPT)
    for file in sorted(KEPT.glob("*.csv")):
        try:
            page = with_table(page, file.stem, text_of(file))
        except ValueError as error:
            print(error, file=sys.stderr)
            return 2
    PAGE.write_text(page, encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
