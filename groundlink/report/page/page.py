# SPDX-License-Identifier: Apache-2.0
"""The report page: an analyzed run as one self-contained HTML file.

Sections without data are left out. Terms are those of the tables of `groundlink up`.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
from importlib.resources import files
from math import radians
from string import Template

import msgspec
import numpy as np
import yaml

from groundlink.core.clock import NANOS
from groundlink.episode.routes import line
from groundlink.expectations.results import COLUMNS
from groundlink.messages.base import NOT_REPORTED
from groundlink.messages.missing_readings import CAUSES as MISSING_CAUSES
from groundlink.messages.missing_readings import in_words
from groundlink.report.analysis.completeness import IN_TRANSIT, UNEXPLAINED, StreamCompleteness
from groundlink.report.analysis.diagnostics import CAUSES, PROCESS_FIELDS
from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.motion import VehicleMotion, passages
from groundlink.report.analysis.plan import SolidOutline, outlines
from groundlink.report.analysis.sensors import (
    CloudSample,
    EstimatedTrajectory,
    ImuSamples,
    reach_m,
    truth_at,
)
from groundlink.report.figures import charts as figures
from groundlink.report.figures import sensors as sensor_figures
from groundlink.report.figures.plan import TALL_M
from groundlink.report.page.verdict import keeps_rate, verdict
from groundlink.scene.build import solids
from groundlink.world import terrain as terrains
from groundlink.world.assets import MissingAsset

from .html import (
    Markup,
    details,
    figure,
    heading,
    joined,
    paragraph,
    picture,
    section,
    table,
    text,
    tiles,
)

Span = tuple[float, float]

LISTED = 100
"""Maximum gaps listed of one stream."""

LEAST_REACH_M = 3.0
"""Half the side of the plan around a cloud is at least this."""


def page(run: RunSummary) -> str:
    """Return the whole page."""
    scenario = run.run.scenario
    span = run.seconds(run.first_nanos), run.seconds(run.last_nanos)
    template = Template(files(__package__).joinpath("page.html").read_text(encoding="utf-8"))
    level = scenario.world.terrain is None
    around = outlines(solids(scenario), level=level)
    sections = [
        _expectations(run),
        _missions(run),
        _trajectory(run, around),
        *_vehicles(run, span),
        *_sensors(run, around, span),
    ]
    sections += [_streams(run, span), _link(run, span)]
    sections += [
        _cameras(run),
        _failures(run),
        _missing_section(run.completeness),
        _processes(run),
        _origin(run),
    ]
    return template.substitute(
        title=text(f"Run {run.run.run}"),
        subtitle=text(" · ".join(filter(None, (scenario.description, _when(run))))),
        verdict=verdict(run),
        facts=_facts(run),
        sections=joined(part for part in sections if part),
        footer=text(f"{run.path.name}, made into a page by groundlink report"),
    )


def _when(run: RunSummary) -> str:
    if not run.run.epoch_nanos:
        return "stamps count from zero"
    begun = datetime.fromtimestamp(run.run.epoch_nanos / NANOS, UTC)
    return f"sim time zero is {begun:%Y-%m-%d %H:%M:%S} UTC"


def _facts(run: RunSummary) -> Markup:
    facts = [(f"{run.duration_seconds:.1f} s", "of sim time")]
    for motion, energy in zip(run.motions, run.energies, strict=True):
        whose = f", {motion.vehicle}" if len(run.motions) > 1 else ""
        facts.append((f"{motion.distance_m:.1f} m", f"driven{whose}"))
        facts.append((f"{motion.top_speed_mps:.2f} m/s", f"top speed{whose}"))
        if energy.last is not None:
            facts.append((_joules(energy.last.motor_work_j), f"work of the motors{whose}"))
        facts.append((str(len(energy.events) + energy.further_events), f"contacts{whose}"))
    facts.append((f"{run.messages:,}".replace(",", "\u202f"), "messages"))
    facts.append((f"{run.size_bytes / 1e6:.1f} MB", "on disk"))
    return tiles(facts)


def _expectations(run: RunSummary) -> Markup:
    """Return the verdicts on the expectations of the scenario."""
    results = run.expectations
    rows = [result.cells for result in results]
    bad = [number for number, result in enumerate(results) if result.is_problem]
    shown = table(COLUMNS, rows, numbers=(2, 3), code=(0,), bad=bad)
    return section("Expectations", shown) if results else Markup("")


def _missions(run: RunSummary) -> Markup:
    """Return what each vehicle was commanded and did, and how it ended."""
    missions = run.missions
    rows = [
        (
            mission.vehicle,
            mission.state,
            _percent(mission.route_share),
            f"{mission.driven_m:.1f} m",
            *_followed(mission.followed_m, mission.commanded_m, mission.speed_share, "m"),
            *_followed(mission.turned_rad, mission.commanded_rad, mission.turn_share, "rad"),
            f"{mission.stuck_seconds:.1f} s",
        )
        for mission in missions
    ]
    columns = (
        *("vehicle", "ends", "route", "driven", "commanded", "followed", "share"),
        *("commanded", "turned", "share", "stuck"),
    )
    off = [number for number, mission in enumerate(missions) if mission.problems()]
    bad = [number for number, mission in enumerate(missions) if mission.ending]
    parts = [table(columns, rows, numbers=range(2, 11), code=(0,), off=off, bad=bad)]
    events = [line for mission in missions for line in mission.problems()]
    parts += [paragraph(line) for line in events]
    return section("Mission", *parts) if missions else Markup("")


def _followed(done: float, asked: float, share: float | None, unit: str) -> tuple[str, str, str]:
    """Return a commanded motion, how much of it was done, and the share."""
    return f"{asked:.1f} {unit}", f"{done:.1f} {unit}", _percent(share)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.0f} %"


def _joules(value: float) -> str:
    return f"{value / 1e3:.2f} kJ" if value >= 1e3 else f"{value:.1f} J"


def _trajectory(run: RunSummary, around: Sequence[SolidOutline]) -> Markup:
    moved = [(m, e) for m, e in zip(run.motions, run.energies, strict=True) if m.rows]
    if not moved:
        return section("Trajectory", paragraph("The file has no ground truth."))
    scenario = run.run.scenario
    routes = [
        line(
            vehicle.route,
            start_m=(vehicle.placement.x_m, vehicle.placement.y_m),
            heading_rad=radians(vehicle.placement.yaw_deg),
        ).points_m
        for vehicle in scenario.vehicles
        if vehicle.route is not None
    ]
    checkpoints = scenario.world.checkpoints
    terrain, heights = scenario.world.terrain, ""
    try:
        ground = terrains.load_ground(terrain) if terrain else None
    except MissingAsset:
        ground, heights = None, " The heights of its terrain are not on this machine."
    drawn = figures.trajectory(
        around, [m for m, _ in moved], [e for _, e in moved], routes, checkpoints, ground
    )
    caption = (
        "From above, by the ground truth of the base, colored by speed. In stronger gray: what "
        f"is taller than {TALL_M:g} m; in weaker: lower things, table tops among them."
    )
    if terrain:
        caption += heights or " Lines are of equal height of the ground."
    parts = [figure(drawn, caption)]
    if checkpoints:
        columns = ("vehicle", "checkpoint", "passed at", "apart")
        rows = [
            (motion.vehicle, by.checkpoint, f"{by.seconds:.2f} s", f"{by.apart_m:.3f} m")
            for motion, _ in moved
            for by in passages(motion.track(), checkpoints)
        ]
        parts.append(table(columns, rows, numbers=(2, 3), code=(0, 1)))
    return section("Trajectory", *parts)


def _vehicles(run: RunSummary, span: Span) -> list[Markup]:
    found = []
    for motion, energy in zip(run.motions, run.energies, strict=True):
        whose = f" of {motion.vehicle}" if len(run.motions) > 1 else ""
        if motion.rows:
            caption = (
                "True: of the base, in its own frame. Asked for: what was on the command topic."
            )
            found.append(section(f"Speed{whose}", figure(figures.speed(motion, span), caption)))
        if energy.last is not None:
            events = [
                (
                    f"{event.begin_seconds:.1f} s",
                    event.name,
                    f"{event.force_n:,.0f} N at {event.force_seconds:.3f} s".replace(",", "\u202f"),
                    f"{event.ticks * 0.0025:.3f} s",
                )
                for event in energy.events
            ]
            columns = ("at", "touched", "largest force of a tick", "touching for")
            parts = [
                figure(
                    figures.energy([energy], span),
                    "Mechanical work of the wheels' motors: where they drive, and what they "
                    "took up where they brake. To turn on the spot is to work on the tires.",
                ),
                table(columns, events, numbers=(2, 3), code=(1,))
                if events
                else paragraph("No contacts except wheels on the ground."),
            ]
            if energy.further_events:
                parts.append(paragraph(f"{energy.further_events} more are not listed."))
            found.append(section(f"Energy and contacts{whose}", *parts))
    return found


def _streams(run: RunSummary, span: Span) -> Markup:
    if not run.streams:
        return Markup("")
    rows, off = [], []
    shown = [stream for stream in run.streams if stream.messages or stream.declared_hz]
    for number, stream in enumerate(shown):
        gaps = stream.largest_gaps
        rows.append(
            (
                stream.topic,
                stream.ros_type.rpartition("/")[2],
                _hz(stream.declared_hz, 0),
                _hz(stream.measured_hz, 2),
                str(stream.messages),
                str(stream.gaps) if stream.declared_hz else "",
                f"{gaps[0].nanos / 1e6:.1f} ms" if gaps else "",
                f"{stream.bytes / 1e6:.1f} MB",
            )
        )
        if not keeps_rate(stream) or stream.gaps or stream.unkept():
            off.append(number)
    columns = ("topic", "type", "declared", "recorded", "messages", "gaps", "longest", "size")
    parts = [table(columns, rows, numbers=range(2, 8), code=(0, 1), off=off)]
    if any(stream.declared_hz for stream in run.streams):
        caption = (
            "Green where a bin of time holds the declared number of messages within 2 %, orange "
            "where it does not, red where there are none. A gap is more than 1.5 periods."
        )
        parts.insert(0, figure(figures.rates(run.streams, span), caption))
    if silent := [stream.topic for stream in run.streams if stream not in shown]:
        parts.append(
            paragraph(f"Nothing came on {', '.join(silent)}; nothing was declared for it.")
        )
    return section("Rates and gaps", *parts)


def _hz(value: float | None, digits: int) -> str:
    if value is None:
        return ""
    return f"{value:g} Hz" if not digits else f"{value:.{digits}f} Hz"


def _link(run: RunSummary, span: Span) -> Markup:
    words = run.diagnostics.streams
    if not words:
        return section(
            "Ages and losses",
            paragraph("No gateway reported in this run, so ages and losses are unknown."),
        )
    rows, off = [], []
    for number, ((topic, direction), stream) in enumerate(words.items()):
        last = stream.last
        is_reported = last.get("reported") != "False"
        arrived = ("messages", "repaired") if is_reported else ("", "")
        causes = [f"{last[cause]} {cause}" for cause in CAUSES if last.get(cause, "0") != "0"]
        rows.append(
            (
                topic if direction == "to ROS" else f"{topic} (back)",
                _milliseconds(last.get("age_seconds", "")),
                _milliseconds(last.get("age_p99_seconds", "")),
                *(last.get(name, "") for name in ("sent", *arrived)),
                ", ".join(causes) or ("none" if is_reported else NOT_REPORTED),
            )
        )
        if causes:
            off.append(number)
    parts: list[str] = []
    if any(stream.ages for stream in words.values()):
        caption = (
            "From the instant of measurement to publication on the ROS side, over the last 10 s of "
            "each moment, on a scale that is logarithmic above 1 ms."
        )
        parts.append(figure(figures.ages(words, span), caption))
    columns = ("topic", "age p50", "p99", "sent", "arrived", "repaired", "lost, by cause")
    parts.append(table(columns, rows, numbers=range(1, 6), code=(0,), off=off))
    return section("Ages and losses", *parts)


def _milliseconds(seconds: str) -> str:
    return f"{1e3 * float(seconds):.1f} ms" if seconds else ""


def _cameras(run: RunSummary) -> Markup:
    parts: list[Markup] = []
    for camera in run.cameras:
        shown = "".join(picture(uri, f"{at:.1f} s") for at, uri in camera.pictures)
        parts.append(heading(camera.topic))
        parts.append(Markup(f'<div class="pictures">{shown}</div>'))
        if camera.unknown:
            parts.append(paragraph(f"{camera.unknown} pictures are of a form not known here."))
    return section("Cameras", *parts)


def _failures(run: RunSummary) -> Markup:
    rows = []
    for failures in run.failures:
        for failure in failures.all:
            end = failure.end_seconds
            until = "the end of the recording" if end is None else f"{end:.4f} s"
            begin = f"{failure.begin_seconds:.4f} s"
            rows.append((failures.sensor, begin, until, str(failure.fault)))
    if not rows:
        return Markup("")
    return section("Faults", table(("sensor", "from", "to", "fault"), rows, code=(0, 3)))


def _processes(run: RunSummary) -> Markup:
    rows = []
    for name, facts in sorted(run.diagnostics.processes.items()):
        counts = [f"{k} {v}" for k, v in facts.items() if k not in PROCESS_FIELDS and v != "0"]
        rows.append((name, facts.get("host", ""), facts.get("pid", ""), ", ".join(counts)))
    if not rows:
        return Markup("")
    return section("Processes", table(("name", "host", "pid", "counts"), rows, code=(0,)))


def _origin(run: RunSummary) -> Markup:
    facts = run.run
    resolved = yaml.safe_dump(msgspec.to_builtins(facts.scenario), sort_keys=False, width=100)
    versions = sorted(facts.versions.items())
    return section(
        "Provenance",
        paragraph(
            f"Scenario {facts.scenario.name}, seed {facts.scenario.seed}, time mode "
            f"{facts.scenario.time.mode}, world {facts.world_hash[:12]}."
        ),
        table(("software", "version"), versions, code=(0, 1)),
        details("The scenario, resolved", resolved),
    )


def _sensors(run: RunSummary, outlines: Sequence[SolidOutline], span: Span) -> list[Markup]:
    """Return a section for each vehicle that has readings to be plotted."""
    found = []
    for motion in run.motions:
        whose = f" of {motion.vehicle}" if len(run.motions) > 1 else ""
        found.append(section(f"Sensors{whose}", *_vehicle(run, motion, outlines, span)))
    return found


def _vehicle(
    run: RunSummary, motion: VehicleMotion, outlines: Sequence[SolidOutline], span: Span
) -> list[Markup]:
    readings, truth = run.readings[motion.vehicle], motion.track()
    parts: list[Markup] = []
    trajectories = [r for r in readings if isinstance(r, EstimatedTrajectory) and r.rows]
    if trajectories and len(truth):
        estimates = [(each.topic, each.beside(truth)) for each in trajectories]
        drawn = sensor_figures.trajectories(truth, estimates, motion.vehicle, span)
        worst = "; ".join(
            f"{topic} by at most {rows[:, 3].max():.2f} m" for topic, rows in estimates
        )
        words = [f"Off the truth: {worst}."]
        if any(each.datum is not None for each in trajectories):
            words.insert(0, "A fix is compared with the place of the antenna.")
        if any(each.datum is None for each in trajectories):
            words.insert(0, "Odometry is laid on the truth at its first pose.")
        caption = " ".join(words)
        parts += [heading("Odometry and GNSS"), figure(drawn, caption)]
    for each in readings:
        if isinstance(each, ImuSamples) and each.rows:
            caption = "In the sensor's frame. A level unit at rest has 9.81 m/s\u00b2 on z."
            drawn = sensor_figures.imu(each, truth, span)
            parts += [heading(each.topic), figure(drawn, caption)]
        elif isinstance(each, CloudSample) and each.seconds is not None and len(truth):
            points = each.in_world(truth)
            x, y, _ = truth_at(truth, np.array([each.seconds]))[0].tolist()
            reach = max(reach_m(points, (x, y)), LEAST_REACH_M)
            drawn = sensor_figures.cloud(points, outlines, (x, y), reach, each.topic)
            caption = (
                f"The message of {each.seconds:.2f} s, {len(points)} points, each laid by the true "
                "place and heading at its own instant."
            )
            parts += [heading(each.topic), figure(drawn, caption)]
    return parts


def _missing_section(streams: Sequence[StreamCompleteness]) -> Markup:
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
    meanings = [f"{cause}: {meaning}" for cause, meaning in MISSING_CAUSES.items() if cause in met]
    if meanings:
        parts.append(paragraph("; ".join(meanings) + "."))
    return section("Missing readings", *parts)
