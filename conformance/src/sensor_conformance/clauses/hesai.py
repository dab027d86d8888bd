# SPDX-License-Identifier: Apache-2.0
"""Packets of Hesai's PandarXT family: structure, counters, azimuths, times, returns, speed."""

import numpy as np

from sensor_conformance.readings.packets import HesaiPackets
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, plot, series_plot

from .clause import ClauseResult, NotTested, clause, findings, result
from .packets import pace, size_plot

MANUAL = "PandarXT User Manual, 3.1"
RETURNS = {
    0x33: 1,
    0x34: 1,
    0x37: 1,
    0x38: 1,
    0x39: 2,
    0x3A: 2,
    0x3B: 2,
    0x3C: 2,
    0x3D: 3,
    0x3E: 2,
}
"""Returns of a firing by return mode: first, second, strongest, last; pairs of them; three."""
MOST_LOST = 0.01
TURNS = 2**32
"""Sequence numbers have 32 bits."""


def _known(topic: HesaiPackets) -> HesaiPackets:
    if not topic.is_known:
        raise NotTested("the structure is not known")
    if len(topic.rows) < 10:
        raise NotTested("fewer than 10 packets")
    return topic


def _returns(topic: HesaiPackets) -> int:
    """Return how many successive blocks have one azimuth: a firing has a block for each return."""
    blocks = topic.azimuths.shape[1]
    same = [
        float(np.mean(np.ptp(topic.azimuths.reshape(len(topic.rows), -1, size), axis=2) == 0))
        for size in (2, 3)
        if blocks % size == 0
    ]
    return max((size for size, share in zip((2, 3), same, strict=False) if share > 0.9), default=1)


@clause(
    "hesai.structure",
    "A packet is as long as lasers and blocks of its header say",
    MANUAL,
    HesaiPackets,
)
def structure(topic: HesaiPackets, recording: CheckedRecording) -> ClauseResult:
    """Headers are all the same; length and marks are those of the manual."""
    if not len(topic.rows):
        raise NotTested("no packets")
    found = [f"packets of {length} bytes" for length in topic.wrong_lengths]
    if len(topic.headers) > 1:
        found.append(f"{len(topic.headers)} different headers")
    elif not topic.is_known:
        found.append(f"{topic.rows.shape[1]} bytes, not the length of the header")
    line = f"{len(topic.rows)} packets"
    if topic.is_known:
        lasers, blocks = topic.headers[0][6:8]
        line += f" of {blocks} blocks of {lasers} lasers"
    return findings(found, line, size_plot(topic))


@clause("hesai.sequence", "Sequence numbers count the packets", MANUAL, HesaiPackets)
def sequence(topic: HesaiPackets, recording: CheckedRecording) -> ClauseResult:
    """Each number is one higher than that before; higher ones show losses."""
    numbers = _known(topic).numbers
    if numbers is None:
        raise NotTested("the device does not count")
    steps = np.diff(numbers) % TURNS
    back = int(np.count_nonzero((steps == 0) | (steps > TURNS / 2)))
    lost = np.where((steps > 1) & (steps <= TURNS / 2), steps - 1, 0)
    share = float(np.sum(lost)) / (float(np.sum(lost)) + len(numbers))
    picture = count_plot("packets lost", lost, each="packet")
    line = f"{int(np.sum(lost))} lost ({100 * share:.2f} %), {back} go back or repeat"
    return result(share <= MOST_LOST and back == 0, line, picture)


@clause(
    "hesai.azimuth", "Azimuths of blocks advance evenly, below 360 degrees", MANUAL, HesaiPackets
)
def azimuth(topic: HesaiPackets, recording: CheckedRecording) -> ClauseResult:
    """From firing to firing, within packets and between them, the head turns by the same angle."""
    firings = _known(topic).azimuths[:, :: _returns(topic)].reshape(-1)
    steps = np.diff(firings) % 360
    usual = float(np.median(steps))
    even = float(np.mean(np.abs(steps - usual) < max(0.3 * usual, 0.03)))
    above = int(np.count_nonzero(firings >= 360))
    picture = plot("firing", "azimuth, degrees", ("azimuth", np.arange(len(firings)), firings))
    line = f"{usual:.2f} degrees a firing, {100 * even:.1f} % even, {above} beyond 360"
    return result(0 < usual < 10 and even > 0.97 and above == 0, line, picture)


@clause(
    "hesai.timestamp",
    "Times are dates and microseconds, and run like the clock of arrival",
    MANUAL,
    HesaiPackets,
)
def timestamp(topic: HesaiPackets, recording: CheckedRecording) -> ClauseResult:
    """Dates exist, microseconds are those of a second, times rise by even steps."""
    times = _known(topic).times
    found = []
    # As unsigned numbers, so that month or day 0 is out of range too.
    _, month, day, hour, minute, second = topic.dates.T
    is_date = (month - 1 < 12) & (day - 1 < 31) & (hour < 24) & (minute < 60) & (second < 61)
    if bad := int(np.count_nonzero(~is_date | (topic.microseconds >= 1_000_000))):
        found.append(f"{bad} are no date and time")
    steps = np.diff(times) / 1e3
    if back := int(np.count_nonzero(steps <= 0)):
        found.append(f"{back} times go back or repeat")
    usual = float(np.median(steps))
    even = float(np.mean(np.abs(steps - usual) < 0.1 * abs(usual) + 2))
    if not (20 < usual < 20_000 and even > 0.97):
        found.append(f"steps of {usual:.0f} us, {100 * even:.1f} % even")
    found += pace(topic, float(times[-1] - times[0]))
    picture = series_plot("step, us", steps, each="packet")
    return findings(found, f"{usual:.0f} us a packet", picture)


@clause(
    "hesai.return_mode",
    "Blocks of one azimuth are as many as the return mode says",
    MANUAL,
    HesaiPackets,
)
def return_mode(topic: HesaiPackets, recording: CheckedRecording) -> ClauseResult:
    """The return mode is known and stays; each return of a firing has a block."""
    modes = [int(mode) for mode in np.unique(_known(topic).modes)]
    found = [f"return mode 0x{mode:02x}" for mode in modes if mode not in RETURNS]
    if len(modes) > 1:
        found.append(f"{len(modes)} return modes")
    seen = _returns(topic)
    if not found and RETURNS[modes[0]] != seen:
        found.append(f"mode 0x{modes[0]:02x} has {RETURNS[modes[0]]} returns, packets have {seen}")
    picture = series_plot("return mode", topic.modes, each="packet")
    return findings(found, f"mode 0x{modes[0]:02x}, blocks in groups of {seen}", picture)


@clause("hesai.motor", "The stated speed is that of azimuths and times", MANUAL, HesaiPackets)
def motor(topic: HesaiPackets, recording: CheckedRecording) -> ClauseResult:
    """Revolutions a minute by successive packets are those of the field."""
    first = _known(topic).azimuths[:, 0]
    seconds = np.diff(topic.times) / 1e9
    turned = np.diff(first) % 360
    good = seconds > 0
    if not np.any(good):
        raise NotTested("times do not rise")
    speeds = turned[good] / seconds[good] / 6
    usual, stated = float(np.median(speeds)), float(np.median(topic.rpm))
    count = np.arange(len(speeds))
    picture = plot(
        "packet", "1/min", ("stated", count, topic.rpm[1:][good]), ("by azimuths", count, speeds)
    )
    holds = abs(stated - usual) < 0.05 * max(usual, 1)
    return result(holds, f"{stated:.0f} stated, {usual:.1f} 1/min by azimuths", picture)
