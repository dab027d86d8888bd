# SPDX-License-Identifier: Apache-2.0
"""Page of a fault campaign: verdicts of sensors and faults as one self-contained HTML file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from string import Template

import msgspec

from groundlink.emulation.script import DIRECTIONS
from groundlink.emulation.settings import Impairment
from groundlink.search.campaign import BEGIN, FAULT, LINK, NONE, PARAMETERS, SENSOR, LinkCondition
from groundlink.search.point_journal import PointRow

from .html import Markup, joined, paragraph, section, table, text, tiles

NOT_RUN = "-"
"""Cell of a fault that a sensor cannot have, or that was left out."""


SIZES = ("reorder_ms", "queue_kb")
"""Fields of an impairment that give the size of another one."""


@dataclass(frozen=True)
class CampaignSummary:
    """Verdicts of a campaign."""

    scenario: str
    check: str | None
    """Shell command; None: the scenario's expectations judge."""

    rows: Sequence[PointRow]
    possible: Mapping[str, Sequence[str]]
    """Kinds of faults that each sensor of the scenario can have, by its name."""

    links: Sequence[LinkCondition]
    """Links; none in a campaign without them."""

    commands: Mapping[int, str]
    """Command lines that repeat failed cells, by number."""

    @property
    def failures(self) -> list[PointRow]:
        """Cells that failed."""
        return [row for row in self.rows if row.outcome.verdict == "failed"]

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns that identify a run."""
        return (SENSOR, FAULT, PARAMETERS, BEGIN, *((LINK,) if self.links else ()))

    def verdicts(self, place: Mapping[str, object], kind: str) -> list[str]:
        """Return the verdicts of a kind of fault at a sensor, begin and link."""
        wanted = {**place, FAULT: kind}
        return [
            row.outcome.verdict
            for row in self.rows
            if all(row.values[name] == value for name, value in wanted.items())
        ]


def campaign_page(summary: CampaignSummary) -> str:
    """Return the whole page."""
    template = Template(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    return template.substitute(
        title=text(f"Faults of {summary.scenario}"),
        subtitle=text(f"Checked by: {summary.check or 'expectations of the scenario'}"),
        verdict=_verdict(summary),
        facts=_facts(summary),
        sections=joined(
            part
            for part in (_matrix(summary), _failures(summary), _coverage(summary), _cells(summary))
            if part
        ),
        footer=text("made by groundlink campaign"),
    )


def _verdict(summary: CampaignSummary) -> Markup:
    failed = summary.failures
    if not failed:
        return Markup('<div class="verdict">All runs passed.</div>')
    line = f"{len(failed)} of {len(summary.rows)} runs failed."
    return Markup(f'<div class="verdict failed">{text(line)}</div>')


def _facts(summary: CampaignSummary) -> Markup:
    tested = {(row.values[SENSOR], row.values[FAULT]) for row in summary.rows} - {(None, NONE)}
    possible = sum(map(len, summary.possible.values()))
    broken = sum(row.outcome.verdict == "broken" for row in summary.rows)
    return tiles(
        [
            (str(len(summary.rows)), "runs"),
            (str(len(summary.failures)), "failed"),
            (str(broken), "without a result"),
            (f"{len(tested)} of {possible}", "pairs of sensor and kind"),
            *([(str(len(summary.links)), "links")] if summary.links else []),
        ]
    )


def _matrix(summary: CampaignSummary) -> Markup:
    kinds = list(dict.fromkeys(row.values[FAULT] for row in summary.rows))
    columns = [name for name in summary.columns if name not in (FAULT, PARAMETERS)]
    places = list(dict.fromkeys(tuple(row.values[n] for n in columns) for row in summary.rows))
    rows = [
        (
            *map(_shown, place),
            *(
                _cell(summary.verdicts(dict(zip(columns, place, strict=True)), kind))
                for kind in kinds
            ),
        )
        for place in places
    ]
    return section("Verdicts", table((*columns, *kinds), rows, numbers=(1,), code=(0, 2)))


def _shown(value: object) -> str:
    return NOT_RUN if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _cell(verdicts: Sequence[str]) -> str:
    """Return the worst verdict, in color if it is a failure."""
    for verdict, css in (("failed", "bad"), ("broken", "off")):
        if verdict in verdicts:
            return Markup(f'<b class="{css}">{verdict}</b>')
    return verdicts[0] if verdicts else NOT_RUN


def _failures(summary: CampaignSummary) -> Markup:
    if not summary.failures:
        return Markup("")
    return section(
        "Failures",
        _listed(summary, summary.failures),
        paragraph("Repeat one of them:"),
        *(
            Markup(f"<pre>{text(summary.commands[row.number])}</pre>")
            for row in summary.failures[:1]
        ),
    )


def _cells(summary: CampaignSummary) -> Markup:
    return section("All runs", _listed(summary, summary.rows))


def _listed(summary: CampaignSummary, rows: Sequence[PointRow]) -> Markup:
    columns = summary.columns
    bad = [number for number, row in enumerate(rows) if row.outcome.verdict == "failed"]
    return table(
        ("run", *columns, "verdict", "last line"),
        [
            (
                str(row.number),
                *(_shown(row.values[name]) for name in columns),
                row.outcome.verdict,
                row.outcome.text,
            )
            for row in rows
        ],
        numbers=(0, 4),
        code=(1,),
        bad=bad,
    )


def _coverage(summary: CampaignSummary) -> Markup:
    def kinds_of(sensor: str) -> set[str]:
        return {row.values[FAULT] for row in summary.rows if row.values[SENSOR] == sensor}

    rows = []
    for sensor, possible in summary.possible.items():
        run = kinds_of(sensor)
        missing = ", ".join(kind for kind in possible if kind not in run)
        share = f"{100 * len(run) / len(possible):.0f} %" if possible else NOT_RUN
        rows.append((sensor, f"{len(run)} of {len(possible)}", share, missing or NOT_RUN))
    faults = table(
        ("sensor", "kinds of faults run", "share", "not run"), rows, numbers=(1, 2), code=(0,)
    )
    return section("Coverage", faults, *([_link_coverage(summary)] if summary.links else []))


def _link_coverage(summary: CampaignSummary) -> Markup:
    """Return which impairments the links of the campaign have in each direction."""
    known = [field.name for field in msgspec.structs.fields(Impairment) if field.name not in SIZES]
    rows = []
    for direction in DIRECTIONS:
        run = {name for link in summary.links for name in link.impairments(direction)}
        missing = [name for name in known if name not in run]
        share = 1 - len(missing) / len(known)
        count = f"{len(known) - len(missing)} of {len(known)}"
        rows.append((direction, count, f"{100 * share:.0f} %", ", ".join(missing) or NOT_RUN))
    return table(
        ("direction", "impairments run", "share", "not run"), rows, numbers=(1, 2), code=(0,)
    )
