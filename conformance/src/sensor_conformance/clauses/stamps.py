# SPDX-License-Identifier: Apache-2.0
"""Stamps: order, rate, jitter, gaps, and the clock that they share."""

import numpy as np

from sensor_conformance.readings.base import Floats, TopicReadings
from sensor_conformance.readings.cloud import CloudReadings
from sensor_conformance.readings.image import CameraInfoReadings, ImageReadings
from sensor_conformance.readings.motion import (
    FixReadings,
    ImuReadings,
    JointReadings,
    OdometryReadings,
)
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.readings.scan import RangeReadings, ScanReadings
from sensor_conformance.readings.transforms import TransformReadings
from sensor_conformance.report.plot import count_plot, plot

from .clause import ClauseResult, NotTested, clause, result

PERIODIC = (
    CameraInfoReadings,
    CloudReadings,
    FixReadings,
    ImageReadings,
    ImuReadings,
    JointReadings,
    OdometryReadings,
    RangeReadings,
    ScanReadings,
)
"""Kinds of sensors that measure at a fixed rate."""

HEADER = "std_msgs/Header: stamp"
MOST_RATE_CHANGE = 0.1
"""Devices on a serial line or USB bus change by some percent."""
MOST_JITTER = 0.5
"""Largest 95th percentile of |interval - period|, as a share of the period ..."""
LEAST_JITTER = 0.015
"""... or this many seconds, because drivers of serial and USB devices stamp at arrival."""
GAP = 1.7
"""Intervals longer than this many periods are gaps."""
MOST_MISSING = 0.01
MOST_CLOCK_OFFSET = 0.5
MOST_DRIFT = 1e-3
"""Clocks of computers drift by 1e-4 at most; stamps of a device that is not disciplined by 1e-3."""


def _intervals(topic: TopicReadings, least: int = 10) -> Floats:
    if len(topic.stamps) < least:
        raise NotTested(f"{len(topic.stamps)} messages; {least} are needed")
    return np.diff(topic.stamps) / 1e9


@clause("stamps.set", "Every message has a stamp", HEADER)
def is_set(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Stamps are not zero."""
    zero = int(np.count_nonzero(topic.stamps == 0))
    picture = count_plot("zero stamps", topic.stamps == 0)
    return result(zero == 0, f"{zero} of {len(topic.stamps)} stamps are zero", picture)


@clause(
    "stamps.increasing", "Stamps of a sensor increase", "REP 145, ROS message_filters", *PERIODIC
)
def increasing(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Each stamp is later than the one before."""
    steps = np.diff(topic.stamps)
    back, same = int(np.count_nonzero(steps < 0)), int(np.count_nonzero(steps == 0))
    picture = plot("message", "stamp, s", ("stamp", np.arange(len(topic.stamps)), topic.seconds))
    return result(back + same == 0, f"{back} stamps go back, {same} repeat the one before", picture)


@clause("stamps.rate", "The rate of a sensor is constant", "data sheets; REP 145", *PERIODIC)
def rate(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Mean intervals of the four quarters, without gaps, of a recording agree."""
    intervals = _intervals(topic, least=40)
    means = [float(np.mean(_without_gaps(part))) for part in np.array_split(intervals, 4)]
    change = max(means) / max(min(means), 1e-9) - 1
    picture = plot(
        "quarter of the recording", "rate, Hz", ("rate", np.arange(1, 5), 1 / np.array(means))
    )
    return result(
        0 <= change <= MOST_RATE_CHANGE,
        f"{1 / np.mean(means):.3f} Hz, changes by {100 * change:.2f} %",
        picture,
    )


@clause(
    "stamps.jitter",
    "Stamps are those of the measurement, not of a queue",
    "sensor_msgs: header.stamp is the time of acquisition",
    *PERIODIC,
)
def jitter(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Most intervals are near the period."""
    intervals = _intervals(topic, least=20)
    period = float(np.mean(intervals))
    off = float(np.percentile(np.abs(intervals - period), 95))
    limit = max(MOST_JITTER * period, LEAST_JITTER)
    picture = plot(
        "time, s",
        "interval, ms",
        ("interval", topic.seconds[1:], intervals * 1e3),
        limits=((period - limit) * 1e3, (period + limit) * 1e3),
        dots=True,
    )
    line = f"95 % of intervals within {off * 1e3:.2f} ms of {period * 1e3:.2f} ms"
    return result(off <= limit, line, picture)


@clause("stamps.gaps", "No messages are missing", "data sheets", *PERIODIC)
def gaps(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Intervals longer than some periods are rare."""
    intervals = _intervals(topic, least=20)
    period = float(np.median(intervals))
    if period <= 0:
        raise NotTested("most stamps repeat")
    long = intervals[intervals > max(GAP * period, LEAST_JITTER)]
    missing = float(np.sum(long / period - 1))
    share = missing / (len(intervals) + missing)
    picture = plot(
        "time, s",
        "interval, periods",
        ("interval", topic.seconds[1:], intervals / period),
        limits=(GAP,),
        dots=True,
    )
    line = f"about {missing:.0f} of {len(intervals) + missing:.0f} missing ({100 * share:.2f} %)"
    return result(share <= MOST_MISSING, line, picture)


@clause(
    "stamps.clock",
    "All sensors share one clock",
    "REP 105 and tf2: transforms are looked up by stamp",
    *PERIODIC,
)
def clock(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """The delay from stamp to arrival is like that of other topics."""
    others = [
        float(np.median(one.received - one.stamps)) / 1e9
        for one in recording.of(TopicReadings)
        if isinstance(one, PERIODIC) and one is not topic and len(one.stamps)
    ]
    if not others:
        raise NotTested("no other topic with stamps")
    delays = (topic.received - topic.stamps) / 1e9
    usual, own = float(np.median(others)), float(np.median(delays))
    picture = plot(
        "time, s",
        "arrival - stamp, s",
        ("delay", topic.seconds, delays),
        limits=(usual,),
        dots=True,
    )
    line = f"arrives {own:.3f} s after its stamp; median of other topics {usual:.3f} s"
    return result(abs(own - usual) <= MOST_CLOCK_OFFSET, line, picture)


@clause(
    "stamps.drift",
    "The clock of stamps runs as fast as that of the recorder",
    "REP 105 and tf2: transforms are looked up by stamp",
    *PERIODIC,
)
def drift(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """The shortest delays from stamp to arrival do not grow."""
    if len(topic.stamps) < 40 or topic.seconds[-1] < 2:
        raise NotTested("fewer than 40 messages or 2 s")
    delays = (topic.received - topic.stamps) / 1e9
    # Queues only add delay: the smallest of each part follows the clocks.
    thirds = [
        (float(np.median(times)), float(np.percentile(part, 10)))
        for times, part in zip(
            np.array_split(topic.seconds, 3), np.array_split(delays, 3), strict=True
        )
    ]
    change = thirds[2][1] - thirds[0][1]
    slope = change / max(thirds[2][0] - thirds[0][0], 1e-9)
    picture = plot(
        "time, s", "arrival - stamp, ms", ("delay", topic.seconds, delays * 1e3), dots=True
    )
    holds = abs(slope) <= MOST_DRIFT or abs(change) < 2 * LEAST_JITTER
    return result(holds, f"{1e6 * slope:.0f} ppm", picture)


@clause(
    "stamps.future",
    "No message arrives before its stamp",
    "sensor_msgs: header.stamp is the time of acquisition",
)
def future(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Arrival is not earlier than acquisition, if both are of the same clock."""
    if isinstance(topic, TransformReadings):
        raise NotTested("transforms may be dated ahead")
    delays = (topic.received - topic.stamps) / 1e9
    if abs(np.median(delays)) > 3600:
        raise NotTested("recorder and stamps have different clocks")
    early = -float(np.percentile(delays, 5))
    limit = max(LEAST_JITTER, topic.period if topic.period > 0 else 0)
    picture = plot(
        "time, s",
        "arrival - stamp, ms",
        ("delay", topic.seconds, delays * 1e3),
        limits=(-limit * 1e3,),
    )
    line = f"5 % of messages arrive {early * 1e3:.1f} ms early or more"
    return result(early <= limit, line, picture)


def _without_gaps(intervals: Floats) -> Floats:
    period = float(np.median(intervals))
    kept = intervals[intervals <= max(GAP * period, LEAST_JITTER)]
    return kept if len(kept) >= 4 else intervals
