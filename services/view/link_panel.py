# SPDX-License-Identifier: Apache-2.0
"""State of the run and its link to ROS, as text and plots.

The verdicts are those of `groundlink.monitor.run_monitor`, as in the table of `groundlink up`.
"""

from collections.abc import Sequence

from groundlink.messages.base import NOT_REPORTED, Health, StreamReport
from groundlink.monitor.run_monitor import RunMonitor, keeps_rate

from .plots import LINE_COLORS, Plots

AGES = "link/age"
RATES = "link/rate"
LOSSES = "link/lost"


def text(title: str, monitor: RunMonitor, *, shown: str) -> str:
    """Return the panel as Markdown."""
    factor = monitor.real_time_factor
    pace = "" if factor is None else f" · {factor:.2f} x real time"
    faults = monitor.faults(needs_reports=False) if monitor.streams else []
    if not monitor.streams:
        verdict = "No delivery report from ROS yet."
    elif faults:
        verdict = "**Not kept:** " + "; ".join(faults)
    elif not monitor.is_reported:
        verdict = "The ROS side has not reported what arrives."
    else:
        verdict = "Every declared rate is kept."
    lines = [f"### {title}", f"{monitor.sim_seconds:.0f} s{pace} · {shown}", "", verdict, ""]
    if monitor.streams:
        lines += [
            "| topic | declared | arrives | age p50 | p99 | lost |",
            "|:--|--:|--:|--:|--:|--:|",
            *(_row(stream) for stream in monitor.streams if stream.messages or _is_unknown(stream)),
            "",
        ]
    names = sorted(monitor.health)
    if names:
        lines.append(f"{len(names)} processes: {', '.join(names)}")
    return "\n".join(lines)


def _row(stream: StreamReport) -> str:
    cells = [
        stream.topic if keeps_rate(stream) else f"**{stream.topic}**",
        _hertz(stream.declared_hz),
        _hertz(stream.measured_hz),
        _milliseconds(stream.age_seconds),
        _milliseconds(stream.age_p99_seconds),
        NOT_REPORTED if _is_unknown(stream) else str(stream.lost),
    ]
    return "| " + " | ".join(cells) + " |"


def _is_unknown(stream: StreamReport) -> bool:
    return bool(stream.sent) and not stream.reported


def _hertz(value: float | None) -> str:
    return "" if value is None else f"{value:.4g} Hz"


def _milliseconds(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds * 1e3:.1f} ms"


def plot(plots: Plots, sim_nanos: int, health: Health) -> None:
    """Plot each stream's age, rate and losses: one line a topic, in the order of the table."""
    for index, stream in enumerate(health.streams):
        color = [LINE_COLORS[index % len(LINE_COLORS)]]
        name = f"{stream.topic} {stream.direction}" if _is_back(stream) else stream.topic
        line = name.strip("/").replace("/", "_").replace(" ", "_")
        for path, value, words in _values(stream):
            if value is not None:
                plots.add(f"{path}/{line}", sim_nanos, [value], [f"{name}{words}"], color)


def _is_back(stream: StreamReport) -> bool:
    return stream.direction != "to ROS"


def _values(stream: StreamReport) -> Sequence[tuple[str, float | None, str]]:
    median, most = stream.age_seconds, stream.age_p99_seconds
    return (
        (AGES, None if median is None else median * 1e3, ""),
        (f"{AGES}_p99", None if most is None else most * 1e3, ""),
        (RATES, stream.measured_hz, ""),
        (LOSSES, float(stream.lost), ""),
    )
