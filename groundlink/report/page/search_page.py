# SPDX-License-Identifier: Apache-2.0
"""Page of a search: its failures, best points and coverage as one self-contained HTML file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from string import Template
from typing import Any

from groundlink.report.figures.search import histograms, objective_chart, pairs
from groundlink.search.coverage import coverage
from groundlink.search.point_journal import PointOutcome, PointRow
from groundlink.search.space import Point, Space, point_text, value_text

from .html import Markup, figure, joined, paragraph, section, table, text, tiles

LISTED = 20
"""Most points listed in a table."""


@dataclass(frozen=True)
class MinimalFailure:
    """The smallest change of the scenario that was found to fail."""

    point: Point
    outcome: PointOutcome
    """Outcome of the second run."""

    command: str
    """Command line that repeats it."""

    @property
    def fails_again(self) -> bool:
        """Whether the second run failed, too."""
        return self.outcome.verdict == "failed"


@dataclass(frozen=True)
class SearchSummary:
    """What a search did and found."""

    scenario: str
    space: Space
    origin: Mapping[str, Any]
    """The scenario's values of the varied fields."""

    rows: Sequence[PointRow]
    """Points of all stages, with a value for each field."""

    objective: str | None
    maximize: bool
    minimal: MinimalFailure | None

    @property
    def searched(self) -> list[PointRow]:
        """Points of the search itself, in their order."""
        return [row for row in self.rows if row.stage == "search"]

    @property
    def failures(self) -> list[PointRow]:
        """Points that failed."""
        return [row for row in self.rows if row.outcome.verdict == "failed"]

    @property
    def best(self) -> list[PointRow]:
        """Points with an objective, the best first."""
        known = [row for row in self.rows if row.outcome.objective is not None]
        sign = -1 if self.maximize else 1
        return sorted(known, key=lambda row: sign * (row.outcome.objective or 0.0))


def search_page(summary: SearchSummary) -> str:
    """Return the whole page."""
    template = Template(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    sections = [
        _minimal(summary),
        _failures(summary),
        _best(summary),
        _objective(summary),
        _coverage(summary),
        _pairs(summary),
    ]
    return template.substitute(
        title=text(f"Search of {summary.scenario}"),
        subtitle=text("Varied: " + "; ".join(map(str, summary.space.fields))),
        verdict=_verdict(summary),
        facts=_facts(summary),
        sections=joined(part for part in sections if part),
        footer=text("made by groundlink search"),
    )


def _verdict(summary: SearchSummary) -> Markup:
    if not summary.failures:
        return Markup('<div class="verdict">No point failed.</div>')
    line = f"{len(summary.failures)} of {len(summary.rows)} points failed."
    if summary.minimal:
        line += f" Smallest failure: {point_text(summary.minimal.point)}."
    return Markup(f'<div class="verdict failed">{text(line)}</div>')


def _facts(summary: SearchSummary) -> Markup:
    facts = [
        (str(len(summary.searched)), "points searched"),
        (str(len(summary.rows)), "runs"),
        (str(len(summary.failures)), "failures"),
    ]
    if best := summary.best:
        facts.append((f"{best[0].outcome.objective:.5g}", f"best {summary.objective}"))
    return tiles(facts)


def _minimal(summary: SearchSummary) -> Markup:
    minimal = summary.minimal
    if minimal is None:
        return Markup("")
    rows = [
        (name, value_text(summary.origin[name]), value_text(value))
        for name, value in minimal.point.items()
    ]
    again = "It failed again" if minimal.fails_again else "It did not fail again"
    return section(
        "Smallest failure",
        table(("field", "scenario", "fails with"), rows, numbers=(1, 2), code=(0,)),
        paragraph(f"{again} in a second run: {minimal.outcome.text}"),
        Markup(f"<pre>{text(minimal.command)}</pre>"),
    )


def _failures(summary: SearchSummary) -> Markup:
    return _listed("Failures", summary, summary.failures)


def _best(summary: SearchSummary) -> Markup:
    return _listed("Best points", summary, summary.best)


def _listed(title: str, summary: SearchSummary, points: Sequence[PointRow]) -> Markup:
    """Return a table of the first points; nothing without points."""
    if not points:
        return Markup("")
    names = [field.name for field in summary.space.fields]
    has_objective = summary.objective is not None
    columns = ["point", *names, *(["objective"] if has_objective else []), "verdict", "last line"]
    rows = []
    for row in points[:LISTED]:
        figure = row.outcome.objective
        rows.append(
            [
                f"{row.stage} {row.number}",
                *(value_text(row.values[name]) for name in names),
                *(["-" if figure is None else f"{figure:.5g}"] if has_objective else []),
                row.outcome.verdict,
                row.outcome.text,
            ]
        )
    bad = [n for n, row in enumerate(points[:LISTED]) if row.outcome.verdict == "failed"]
    more = len(points) - LISTED
    return section(
        title,
        table(columns, rows, numbers=range(1, 1 + len(names) + has_objective), bad=bad),
        paragraph(f"{more} more are in points.csv." if more > 0 else ""),
    )


def _objective(summary: SearchSummary) -> Markup:
    if summary.objective is None or not any(
        row.outcome.objective is not None for row in summary.searched
    ):
        return Markup("")
    chart = objective_chart(summary.searched, summary.objective, maximize=summary.maximize)
    return section("Objective", figure(chart, "points of the search in their order"))


def _coverage(summary: SearchSummary) -> Markup:
    points = [row.values for row in summary.searched]
    covered = [coverage(field, points) for field in summary.space.fields]
    rows = [
        (
            each.field.name,
            str(each.field).partition("=")[2],
            f"{each.visited} of {len(each.counts)}",
            f"{100 * each.share:.0f} %",
        )
        for each in covered
    ]
    return section(
        "Coverage",
        table(("field", "values", "bins visited", "share"), rows, numbers=(2, 3), code=(0,)),
        figure(histograms(covered), "points of the search by value; a range has up to 10 bins"),
    )


def _pairs(summary: SearchSummary) -> Markup:
    if len(summary.space.fields) < 2 or not summary.searched:
        return Markup("")
    drawn = pairs(summary.space.fields, summary.searched)
    return section("Pairs of fields", figure(drawn, "points of the search with their verdicts"))
