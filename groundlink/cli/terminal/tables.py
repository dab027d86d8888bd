# SPDX-License-Identifier: Apache-2.0
"""Tables that fit the terminal without truncating numbers.

On a narrow terminal a table first omits optional columns, then folds paths, then wraps text, then
splits into several tables with the same first column.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table

FOLDED_WIDTH = 16
"""Minimum width of a column of paths."""


class Column(NamedTuple):
    """A column of a table."""

    name: str
    kind: str = "number"
    """`number`: right-aligned, never truncated. `text`: truncated in the first column only.
    `path`: folds at slashes, for a first column. `words`: wraps between words."""

    omit_order: int = 0
    """Order of omission: 1 first, then 2; 0 never."""


class FittingTable:
    """A table that omits or splits columns until its numbers fit.

    Parameters
    ----------
    columns
        the first column identifies a row.
    padding
        spaces on both sides of each cell.
    """

    def __init__(self, title: str, columns: Iterable[Column], *, padding: int = 0) -> None:
        self._title, self._padding = title, padding
        self._columns = tuple(columns)
        self._rows: list[tuple[tuple[str, ...], str]] = []

    def add_row(self, *cells: str, style: str = "") -> None:
        """Add a row with a cell for each column."""
        assert len(cells) == len(self._columns)
        self._rows.append((cells, style))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Render at the available width."""
        for number, shown in enumerate(self._parts(options.max_width)):
            yield self._table(shown, "" if number else self._title, options.max_width)

    def _parts(self, width: int) -> Iterator[list[int]]:
        """Yield the column indices of each table."""
        shown = list(range(len(self._columns)))
        for order in sorted({column.omit_order for column in self._columns if column.omit_order}):
            if self._width(shown) <= width:
                break
            shown = [at for at in shown if self._columns[at].omit_order != order]
        if not self._rows or self._width(shown) - self._spare(shown[0]) <= width:
            yield shown
            return
        first, *rest = shown
        part = [first]
        for at in rest:
            if len(part) > 1 and self._width([*part, at]) > width:
                yield part
                part = [first]
            part.append(at)
        yield part

    def _width(self, shown: Sequence[int]) -> int:
        """Return the minimum width of a table with these columns."""
        return sum(map(self._min_width, shown)) + self._frame(len(shown))

    def _spare(self, at: int) -> int:
        """Return by how much a column of paths can be narrower than its longest path."""
        is_path = self._columns[at].kind == "path"
        return max(self._min_width(at) - FOLDED_WIDTH, 0) if is_path else 0

    def _frame(self, count: int) -> int:
        return 1 + count * (1 + 2 * self._padding)

    def _min_width(self, at: int) -> int:
        """Return the minimum width of a column: its longest cell, or word if it wraps."""
        column = self._columns[at]
        cells = [column.name, *(cells[at] for cells, _ in self._rows)]
        if column.kind == "words":
            cells = [word for cell in cells for word in cell.split()]
        return max(map(cell_len, cells), default=0)

    def _table(self, shown: Sequence[int], title: str, width: int) -> Table:
        table = Table(
            title=title or None,
            title_justify="left",
            expand=False,
            padding=(0, self._padding),
        )
        first, *others = shown
        widths = {at: self._min_width(at) for at in shown}
        room = width - self._frame(len(shown)) - sum(widths[at] for at in others)
        folds = widths[first] > room
        is_path = self._columns[first].kind == "path"
        if folds and is_path:
            widths[first] = room
        for at in shown:
            column = self._columns[at]
            # Fold a first column that is too wide; keep the other columns complete.
            is_folded = at == first and folds
            table.add_column(
                column.name,
                justify="right" if column.kind == "number" else "left",
                no_wrap=column.kind != "words" and not is_folded,
                overflow="fold" if at == first else "ellipsis",
                min_width=None if is_folded and not is_path else widths[at],
                max_width=widths[at] if folds and is_path else None,
            )
        for cells, style in self._rows:
            name = _folded(cells[first], room) if is_path else cells[first]
            table.add_row(name, *(cells[at] for at in others), style=style)
        return table


def _folded(path: str, width: int) -> str:
    """Return a path in lines that end before slashes."""
    lines = [""]
    for step in re.findall("/?[^/]+|/", path):
        if lines[-1] and cell_len(lines[-1] + step) > width:
            lines.append("")
        lines[-1] += step
    return "\n".join(lines)
