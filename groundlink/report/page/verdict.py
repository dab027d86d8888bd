# SPDX-License-Identifier: Apache-2.0
"""Verdict: the problems of a run, listed at the top of the page.

A run is fine only if no bar of the page is orange or red.
"""

from collections.abc import Sequence

from groundlink.expectations.results import problems as expectation_problems
from groundlink.messages.missing_readings import in_words
from groundlink.monitor.run_monitor import RATE_TOLERANCE
from groundlink.report.analysis.completeness import IN_TRANSIT, StreamCompleteness
from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.streams import StreamTimes
from groundlink.report.page.html import Markup, text

Span = tuple[float, float]

SPANS = 3
"""Maximum spans in a line."""


def problems(run: RunSummary) -> list[str]:
    """Return the problems of a run as lines.

    Expectations that did not pass come first, then how missions ended badly.
    """
    lines = expectation_problems(run.expectations)
    lines += [line for mission in run.missions for line in mission.problems()]
    for stream in run.streams:
        if not keeps_rate(stream):
            measured = "none" if stream.measured_hz is None else f"{stream.measured_hz:.2f} Hz"
            lines.append(f"{stream.topic}: declared {stream.declared_hz:g} Hz, recorded {measured}")
        if stream.gaps:
            gaps = "1 gap" if stream.gaps == 1 else f"{stream.gaps} gaps"
            longest = stream.largest_gaps[0].nanos / 1e6
            lines.append(f"{stream.topic}: {gaps}, the longest of {longest:.0f} ms")
        elif keeps_rate(stream) and (spans := stream.unkept()):
            lines.append(f"{stream.topic}: not {stream.declared_hz:g} Hz {_spans(run, spans)}")
    lines += _missing_lines(run.completeness)
    for (topic, direction), words in run.diagnostics.streams.items():
        lost, sent = words.last.get("lost", "0"), words.last.get("sent", "")
        if lost != "0":
            lines.append(f"{topic}: {lost} of {sent} lost {direction}")
    for energy in run.energies:
        if energy.events:
            names = ", ".join(dict.fromkeys(event.name for event in energy.events))
            lines.append(f"{energy.vehicle} touched {names}")
    for failures in run.failures:
        if failures.all:
            kinds = ", ".join(dict.fromkeys(failure.fault.kind for failure in failures.all))
            lines.append(f"{failures.sensor} had injected faults: {kinds}")
    if run.undecodable:
        lines.append(f"{run.undecodable} messages could not be read")
    return lines


def _missing_lines(streams: Sequence[StreamCompleteness]) -> list[str]:
    """Return one line for each stream with missing readings."""
    lines = []
    for stream in streams:
        missing = stream.missing()
        del missing[IN_TRANSIT]
        if missing:
            lines.append(f"{stream.topic}: of {stream.due} readings {in_words(missing)}")
    return lines


def _spans(run: RunSummary, spans: Sequence[Span]) -> str:
    """Return the first spans as text, in sim time."""
    begin = run.seconds(run.first_nanos)
    words = [f"from {begin + low:.1f} to {begin + high:.1f} s" for low, high in spans[:SPANS]]
    more = len(spans) - SPANS
    return ", ".join(words) + (f" and {more} more" if more > 0 else "")


def keeps_rate(stream: StreamTimes) -> bool:
    """Return whether a stream has its declared rate on average."""
    if stream.declared_hz is None:
        return True
    measured = stream.measured_hz
    return measured is not None and abs(measured / stream.declared_hz - 1) <= RATE_TOLERANCE


def verdict(run: RunSummary) -> Markup:
    """Return the verdict box: all fine, or the list of problems."""
    found = problems(run)
    if not found:
        return Markup(
            '<div class="verdict">Every declared rate was kept from the first message to the last, '
            "without a gap, every vehicle followed its commands, and nothing was touched.</div>"
        )
    items = "".join(f"<li>{text(fault)}</li>" for fault in found)
    is_failed = any(mission.ending for mission in run.missions) or any(
        result.is_problem for result in run.expectations
    )
    kind = "failed" if is_failed else "bad"
    return Markup(f'<div class="verdict {kind}">Problems:<ul>{items}</ul></div>')
