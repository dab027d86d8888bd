# SPDX-License-Identifier: Apache-2.0
"""Section about missing readings: every gap with its cause, the first ones of long lists."""

from collections.abc import Sequence

from groundlink.core.clock import NANOS
from groundlink.messages.missing_readings import CAUSES, in_words
from groundlink.report.analysis.completeness import IN_TRANSIT, UNEXPLAINED, StreamCompleteness
from groundlink.report.page.html import Markup, paragraph, section, table

LISTED = 100
"""Maximum gaps listed of one stream."""


def missing_lines(streams: Sequence[StreamCompleteness]) -> list[str]:
    """Return one line for each stream with missing readings."""
    lines = []
    for stream in streams:
        missing = stream.missing()
        del missing[IN_TRANSIT]
        if missing:
            lines.append(f"{stream.topic}: of {stream.due} readings {in_words(missing)}")
    return lines


def missing_section(streams: Sequence[StreamCompleteness]) -> Markup:
    """Return the section; empty without sensors."""
    sums: list[tuple[str, ...]] = []
    gaps: list[tuple[str, ...]] = []
    off: list[int] = []
    unknown: list[int] = []
    further = 0
    for stream in streams:
        holes, missing = stream.holes(), stream.missing()
        if missing.keys() - {IN_TRANSIT}:
            off.append(len(sums))
        sums.append((stream.topic, str(stream.due), str(stream.published), in_words(missing)))
        further += len(holes[LISTED:])
        for hole in holes[:LISTED]:
            if hole.cause == UNEXPLAINED:
                unknown.append(len(gaps))
            stamps = (f"{nanos / NANOS:.4f} s" for nanos in (hole.first_nanos, hole.last_nanos))
            gaps.append((stream.topic, *stamps, str(hole.readings), hole.cause))
    if not sums:
        return Markup("")
    parts = [
        table(("topic", "due", "recorded", "missing"), sums, numbers=(1, 2), code=(0,), off=off),
        paragraph("Due is what the scenario declares, reading by reading."),
    ]
    if gaps:
        columns = ("topic", "from", "to", "readings", "cause")
        parts.append(table(columns, gaps, numbers=(1, 2, 3), code=(0,), off=unknown))
        parts.append(paragraph("Times are the stamps of the first and the last that is missing."))
    if further:
        parts.append(paragraph(f"{further} more are not listed."))
    met = {row[-1] for row in gaps}
    meanings = [f"{cause}: {meaning}" for cause, meaning in CAUSES.items() if cause in met]
    if meanings:
        parts.append(paragraph("; ".join(meanings) + "."))
    return section("Missing readings", *parts)
