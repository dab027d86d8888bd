# SPDX-License-Identifier: Apache-2.0
"""Page of a fault campaign: verdicts of sensors and faults as one self-contained HTML file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from string import Template

from groundlink.search.campaign import BEGIN, FAULT, PARAMETERS, SENSOR
from groundlink.search.point_journal import PointRow

from .html import Markup, joined, paragraph, section, table, text, tiles

NOT_RUN = "-"
"""Cell of a fault that a sensor cannot have, or that was left out."""


@dataclass(frozen=True)
class CampaignSummary:
    """Verdicts of a campaign."""

    scenario: str
    check: str
    rows: Sequence[PointRow]
    possible: Mapping[str, Sequence[str]]
    """Kinds of faults that each sensor of the scenario can have, by its name."""

    commands: Mapping[int, str]
    """Command lines that repeat failed cells, by number."""

    @property
    def failures(self) -> list[PointRow]:
        """Cells that failed."""
        return [row for row in self.rows if row.outcome.verdict == "failed"]

    def verdicts(self, sensor: str, begin_s: float, kind: str) -> list[str]:
        """Return the verdicts of a sensor, a begin and a kind of fault."""
        wanted = {SENSOR: sensor, BEGIN: begin_s, FAULT: kind}
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
        subtitle=text(f"Checked by: {summary.check}"),
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
        return Markup('<div class="verdict">The check passed with every fault.</div>')
    line = f"The check failed with {len(failed)} of {len(summary.rows)} faults."
    return Markup(f'<div class="verdict failed">{text(line)}</div>')


def _facts(summary: CampaignSummary) -> Markup:
    tested = {(row.values[SENSOR], row.values[FAULT]) for row in summary.rows}
    possible = sum(map(len, summary.possible.values()))
    broken = sum(row.outcome.verdict == "broken" for row in summary.rows)
    return tiles(
        [
            (str(len(summary.rows)), "runs with a fault"),
            (str(len(summary.failures)), "failed"),
            (str(broken), "without a result"),
            (f"{len(tested)} of {possible}", "pairs of sensor and kind"),
        ]
    )


def _matrix(summary: CampaignSummary) -> Markup:
    kinds = list(dict.fromkeys(row.values[FAULT] for row in summary.rows))
    places = dict.fromkeys((row.values[SENSOR], row.values[BEGIN]) for row in summary.rows)
    rows = [
        (
            sensor,
            f"{begin_s:g} s",
            *(_cell(summary.verdicts(sensor, begin_s, kind)) for kind in kinds),
        )
        for sensor, begin_s in places
    ]
    return section("Verdicts", table(("sensor", "from", *kinds), rows, numbers=(1,), code=(0,)))


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
        _listed(summary.failures),
        paragraph("Repeat one of them:"),
        *(
            Markup(f"<pre>{text(summary.commands[row.number])}</pre>")
            for row in summary.failures[:1]
        ),
    )


def _cells(summary: CampaignSummary) -> Markup:
    return section("All runs", _listed(summary.rows))


def _listed(rows: Sequence[PointRow]) -> Markup:
    columns = (SENSOR, FAULT, PARAMETERS, BEGIN)
    bad = [number for number, row in enumerate(rows) if row.outcome.verdict == "failed"]
    return table(
        ("run", *columns, "verdict", "last line"),
        [
            (
                str(row.number),
                *(str(row.values[name]) for name in columns),
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
    return section(
        "Coverage",
        table(
            ("sensor", "kinds of faults run", "share", "not run"), rows, numbers=(1, 2), code=(0,)
        ),
    )
