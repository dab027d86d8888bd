# SPDX-License-Identifier: Apache-2.0
"""The report as one HTML page: no script, nothing from a network, everything escaped."""

from html import escape

from sensor_conformance.checking import CheckReport, CheckResult
from sensor_conformance.clauses.clause import Verdict

from .svg import svg

STYLE = """
:root { color-scheme: light dark; }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; }
td, th { border-bottom: 1px solid #8884; padding: .25rem .5rem; text-align: left; }
td.number { text-align: right; }
.failed { color: #c62828; font-weight: 600; }
.passed { color: #2e7d32; }
details { border-bottom: 1px solid #8884; padding: .3rem 0; }
summary { cursor: pointer; }
svg { display: block; max-width: 40rem; width: 100%; }
svg text { fill: currentColor; font-size: 11px; }
svg .frame { fill: none; stroke: #8888; }
svg .limit { stroke: #c62828; stroke-dasharray: 4 3; }
svg polyline { fill: none; stroke-width: 1.3; }
svg .dots { stroke-linecap: round; stroke-width: 4; }
"""


def page(report: CheckReport) -> str:
    """Return the page."""
    counts = report.counts()
    numbers = ", ".join(f"{counts[verdict]} {verdict.value}" for verdict in Verdict)
    parts = [
        "<!doctype html>",
        '<html lang="en"><head><meta charset="utf-8">',
        f"<title>Conformance of {escape(report.name)}</title><style>{STYLE}</style></head><body>",
        f"<h1>Conformance of {escape(report.name)}</h1>",
        f"<p>{len(report.topics)} topics; clauses: {numbers}.</p>",
    ]
    if report.findings:
        parts.append("<h2>Findings</h2>")
        parts += [_entry(one, is_open=True) for one in report.findings]
    parts.append("<h2>Topics</h2>" + _topics(report))
    families = dict.fromkeys(one.clause.id.partition(".")[0] for one in report.results)
    for family in families:
        parts.append(f"<h2>{escape(family)}</h2>")
        parts += [
            _entry(one)
            for one in report.results
            if one.clause.id.partition(".")[0] == family
            and one.result.verdict is not Verdict.FAILED
        ]
    parts.append("</body></html>")
    return "\n".join(parts)


def _topics(report: CheckReport) -> str:
    rows = ["<table><tr><th>topic</th><th>type</th><th>messages</th><th>failed</th></tr>"]
    for name, kind, messages in report.topics:
        failed = sum(one.topic == name for one in report.findings)
        mark = ' class="failed"' if failed else ""
        rows.append(
            f"<tr><td>{escape(name)}</td><td>{escape(kind)}</td>"
            f'<td class="number">{messages}</td><td{mark}>{failed or ""}</td></tr>'
        )
    for name, why in report.unread.items():
        rows.append(f'<tr><td>{escape(name)}</td><td colspan="3">not read: {escape(why)}</td></tr>')
    return "".join(rows) + "</table>"


def _entry(one: CheckResult, is_open: bool = False) -> str:
    verdict = one.result.verdict
    mark = verdict.name.lower().replace("_", "-")
    picture = svg(one.result.picture) if one.result.picture else ""
    return (
        f"<details{' open' if is_open else ''}><summary>"
        f'<span class="{mark}">{verdict.value}</span> <code>{escape(one.clause.id)}</code> '
        f"{escape(one.topic)}: {escape(one.result.line)}</summary>"
        f"<p>{escape(one.clause.title)}. Source: {escape(one.clause.source)}.</p>"
        f"{picture}</details>"
    )
