# SPDX-License-Identifier: Apache-2.0
"""Point packets of Livox LiDARs of SDK 2: structure, checksum, counters, times, coordinates."""

import numpy as np

from sensor_conformance.readings.packets import LivoxPackets
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, plot, series_plot
from sensor_conformance.sources.pcap import LIVOX_HEADER, LIVOX_POINTS

from .clause import ClauseResult, NotTested, clause, findings, result
from .packets import pace, size_plot

PROTOCOL = "Livox wiki: communication protocol of the Mid-360"
TIME_TYPES = (0, 1, 2)
"""Not synchronized, PTP, GPS."""
MOST_LOST = 0.01
FARTHEST = 500.0
"""Meters, beyond what any Livox device measures."""


def _known(topic: LivoxPackets) -> LivoxPackets:
    if not topic.is_known:
        raise NotTested("the structure is not known")
    if len(topic.rows) < 10:
        raise NotTested("fewer than 10 packets")
    return topic


@clause(
    "livox.structure",
    "A packet is as long as type and number of its points say",
    PROTOCOL,
    LivoxPackets,
)
def structure(topic: LivoxPackets, recording: CheckedRecording) -> ClauseResult:
    """Version, types and lengths are those of the protocol."""
    found = [f"packets of {length} bytes" for length in topic.wrong_lengths]
    if not topic.is_known:
        found.append(f"{topic.rows.shape[1]} bytes are no header")
        return findings(found, "", size_plot(topic))
    size = topic.rows.shape[1]
    sizes = np.array([LIVOX_POINTS.get(int(kind), 0) for kind in topic.data_types])
    expected = LIVOX_HEADER + topic.points * sizes
    for name, wrong in (
        ("version", topic.versions != 0),
        ("type of data", sizes == 0),
        ("type of time", ~np.isin(topic.time_types, TIME_TYPES)),
        ("length", topic.lengths != size),
        ("number of points", (sizes > 0) & (expected != size)),
    ):
        if bad := int(np.count_nonzero(wrong)):
            found.append(f"{bad} packets with a wrong {name}")
    line = f"{len(topic.rows)} packets of {int(topic.points[0])} points"
    return findings(found, line, size_plot(topic))


@clause("livox.checksum", "The CRC-32 is that of time and points", PROTOCOL, LivoxPackets)
def checksum(topic: LivoxPackets, recording: CheckedRecording) -> ClauseResult:
    """The checksum of each packet is that of its bytes from the time on."""
    wrong = _known(topic).checksums != topic.computed
    bad = int(np.count_nonzero(wrong))
    picture = count_plot("wrong checksums", wrong, each="packet")
    return result(bad == 0, f"{bad} of {len(wrong)} are wrong", picture)


@clause("livox.counter", "Numbers count the packets of a frame from 0", PROTOCOL, LivoxPackets)
def counter(topic: LivoxPackets, recording: CheckedRecording) -> ClauseResult:
    """Each number is one higher than that before, or 0; others show losses."""
    numbers = _known(topic).numbers
    steps = np.diff(numbers)
    if not steps.any():
        return result(False, f"all numbers are {int(numbers[0])}")
    # After a lost end of a frame, the packets that are missing in the next are known.
    lost = np.where(steps > 0, steps - 1, numbers[1:])
    share = float(np.sum(lost)) / (float(np.sum(lost)) + len(numbers))
    picture = plot("packet", "number", ("number", np.arange(len(numbers)), numbers))
    return result(share <= MOST_LOST, f"{int(np.sum(lost))} lost ({100 * share:.2f} %)", picture)


@clause(
    "livox.timestamp",
    "Times rise by the stated interval, and run like the clock of arrival",
    PROTOCOL,
    LivoxPackets,
)
def timestamp(topic: LivoxPackets, recording: CheckedRecording) -> ClauseResult:
    """From packet to packet, times rise by the interval of the header."""
    times = _known(topic).times
    steps, interval = np.diff(times) / 1e3, float(np.median(topic.intervals)) / 1e3
    found = []
    if back := int(np.count_nonzero(steps <= 0)):
        found.append(f"{back} times go back or repeat")
    usual = float(np.median(steps))
    if not abs(usual - interval) < 0.1 * interval + 2:
        found.append(f"steps of {usual:.0f} us, interval {interval:.0f} us")
    even = float(np.mean(np.abs(steps - usual) < 0.1 * abs(usual) + 2))
    if even < 0.97:
        found.append(f"{100 * even:.1f} % even")
    found += pace(topic, float(times[-1] - times[0]))
    picture = series_plot("step, us", steps, each="packet")
    return findings(found, f"{usual:.0f} us a packet", picture)


@clause(
    "livox.points",
    "Coordinates are in the unit of their type, and zero without a return",
    PROTOCOL,
    LivoxPackets,
)
def points(topic: LivoxPackets, recording: CheckedRecording) -> ClauseResult:
    """Some points are returns, at distances that a device measures."""
    if (places := _known(topic).coordinates()) is None:
        raise NotTested("no Cartesian coordinates")
    distance = np.linalg.norm(places, axis=1)
    returns = distance[distance > 0]
    share = len(returns) / max(len(distance), 1)
    if share < 0.01:
        return result(False, f"{100 * share:.2f} % return")
    median, far = float(np.median(returns)), float(np.mean(returns > FARTHEST))
    ranks = np.linspace(0, 1, 200)
    picture = plot("share below", "distance, m", ("points", ranks, np.quantile(returns, ranks)))
    line = f"median {median:.3f} m, {100 * share:.0f} % return, {100 * far:.2f} % too far"
    return result(median > 0.05 and far < 0.001, line, picture)
