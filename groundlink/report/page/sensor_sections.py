# SPDX-License-Identifier: Apache-2.0
"""Sections about sensor readings compared with the ground truth."""

from collections.abc import Sequence

import numpy as np

from groundlink.report.analysis.gather import RunSummary
from groundlink.report.analysis.motion import VehicleMotion
from groundlink.report.analysis.plan import SolidOutline
from groundlink.report.analysis.sensors import (
    CloudSample,
    EstimatedTrajectory,
    ImuSamples,
    reach_m,
    truth_at,
)
from groundlink.report.figures import sensors as sensor_figures

from .html import Markup, figure, heading, section

Span = tuple[float, float]

LEAST_REACH_M = 3.0


def sensors(run: RunSummary, outlines: Sequence[SolidOutline], span: Span) -> list[Markup]:
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
