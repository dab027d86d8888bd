# SPDX-License-Identifier: Apache-2.0
"""Packets of Velodyne and Ouster: structure and timing as their manuals have them."""

import numpy as np

from sensor_conformance.readings.packets import (
    COLUMNS,
    OusterImuPackets,
    OusterPackets,
    PacketReadings,
    VelodynePackets,
)
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import ClausePlot, plot, series_plot

from .clause import ClauseResult, NotTested, clause, findings, result

VLP_16 = "VLP-16 User Manual, 9.3"
OUSTER = "Ouster Firmware User Manual: lidar data packet"
FLAGS = (0xEEFF, 0xDDFF, 0xCCFF, 0xBBFF)
"""Marks of blocks, little-endian; the last three are those of further banks of a VLS-128."""
RETURN_MODES = (0x37, 0x38, 0x39, 0x3A, 0x3B)
PRODUCTS = {
    0x21: "HDL-32E",
    0x22: "VLP-16",
    0x24: "Puck Hi-Res",
    0x28: "VLP-32C",
    0x31: "Velarray",
    0xA1: "VLS-128",
}
HOUR = 3_600_000_000
"""Microseconds."""
RESOLUTIONS = (512, 1024, 2048, 4096)
G_LIMITS = (0.9, 1.1)


def size_plot(topic: PacketReadings) -> ClausePlot:
    """Return the bytes of each packet."""
    return series_plot("bytes", topic.sizes, each="packet")


def pace(topic: PacketReadings, passed: float) -> list[str]:
    """Return a finding if the clock of packets does not run like that of their arrival.

    Parameters
    ----------
    topic
        The packets, with their times of arrival. Below 2 s these say too little.
    passed
        Nanoseconds from the first packet to the last by the device.
    """
    arrived = float(topic.arrivals[-1] - topic.arrivals[0])
    if len(topic.arrivals) != len(topic.rows) or arrived <= 2e9:
        return []
    ratio = passed / arrived
    return [] if 0.95 < ratio < 1.05 else [f"{ratio:.3f} times as fast as packets arrive"]


@clause(
    "velodyne.structure", "A packet has 1206 bytes and 12 marked blocks", VLP_16, VelodynePackets
)
def velodyne_structure(topic: VelodynePackets, recording: CheckedRecording) -> ClauseResult:
    """Lengths and marks are those of the manual."""
    found = [f"packets of {length} bytes" for length in topic.wrong_lengths]
    if bad := int(np.count_nonzero(~np.isin(topic.flags, FLAGS))):
        found.append(f"{bad} blocks without a mark")
    return findings(found, f"{len(topic.rows)} packets", size_plot(topic))


@clause("velodyne.factory", "Factory bytes name return mode and product", VLP_16, VelodynePackets)
def velodyne_factory(topic: VelodynePackets, recording: CheckedRecording) -> ClauseResult:
    """Both bytes are known, and the same in all packets."""
    pairs = {(int(mode), int(product)) for mode, product in topic.factory}
    found = [
        f"return mode 0x{mode:02x}, product 0x{product:02x}"
        for mode, product in sorted(pairs)
        if mode not in RETURN_MODES or product not in PRODUCTS
    ]
    if len({product for _, product in pairs}) > 1:
        found.append("products differ")
    count = np.arange(len(topic.factory))
    picture = plot(
        "packet",
        "byte",
        ("return mode", count, topic.factory[:, 0]),
        ("product", count, topic.factory[:, 1]),
    )
    line = ", ".join(PRODUCTS.get(product, "") for _, product in sorted(pairs))
    return findings(found, line, picture)


@clause("velodyne.azimuth", "Azimuths advance evenly, below 360 degrees", VLP_16, VelodynePackets)
def velodyne_azimuth(topic: VelodynePackets, recording: CheckedRecording) -> ClauseResult:
    """From packet to packet, the head turns by the same angle."""
    first = topic.azimuths[:, 0]
    if len(first) < 10:
        raise NotTested("fewer than 10 packets")
    steps = np.diff(first) % 360
    usual = float(np.median(steps))
    even = float(np.mean(np.abs(steps - usual) < max(0.3 * usual, 0.3)))
    above = int(np.count_nonzero(topic.azimuths >= 360))
    picture = plot("packet", "azimuth, degrees", ("azimuth", np.arange(len(first)), first))
    line = f"{usual:.2f} degrees a packet, {100 * even:.1f} % even, {above} beyond 360"
    return result(0 < usual < 90 and even > 0.97 and above == 0, line, picture)


@clause(
    "velodyne.timestamp",
    "Times are microseconds since the hour, and run like the clock of arrival",
    VLP_16,
    VelodynePackets,
)
def velodyne_timestamp(topic: VelodynePackets, recording: CheckedRecording) -> ClauseResult:
    """Times rise by even steps, except at the hour."""
    if len(topic.microseconds) < 10:
        raise NotTested("fewer than 10 packets")
    steps = np.diff(topic.microseconds) % HOUR
    usual = float(np.median(steps))
    even = float(np.mean(np.abs(steps - usual) < 0.1 * usual + 2))
    found = []
    if np.any(topic.microseconds >= HOUR):
        found.append("beyond an hour")
    if not (20 < usual < 20_000 and even > 0.97):
        found.append(f"steps of {usual:.0f} us, {100 * even:.1f} % even")
    found += pace(topic, float(np.sum(steps)) * 1e3)
    picture = plot("packet", "step, us", ("step", np.arange(len(steps)), steps), dots=True)
    return findings(found, f"{usual:.0f} us a packet", picture)


@clause("ouster.structure", "A packet has the length of a format", OUSTER, OusterPackets)
def ouster_structure(topic: OusterPackets, recording: CheckedRecording) -> ClauseResult:
    """All packets have one length, which holds 16 columns."""
    found = [f"packets of {length} bytes" for length in topic.wrong_lengths]
    if not topic.is_known:
        found.append(f"{topic.rows.shape[1]} bytes are no 16 columns")
    kind = "legacy" if topic.is_legacy else "with header"
    line = f"{len(topic.rows)} packets of {topic.rows.shape[1]} bytes, {kind}"
    return findings(found, line, size_plot(topic))


@clause("ouster.columns", "Columns count up to the end of the revolution", OUSTER, OusterPackets)
def ouster_columns(topic: OusterPackets, recording: CheckedRecording) -> ClauseResult:
    """Numbers rise by one, and a frame's number by one with each revolution."""
    numbers = topic.measurements
    if len(numbers) < 2 * COLUMNS:
        raise NotTested("fewer than 2 packets")
    steps, frames = np.diff(numbers), np.diff(topic.frame_numbers)
    inner = (steps == 1) & (frames == 0)
    turn = (numbers[1:] < numbers[:-1]) & ((frames == 1) | (frames < -60_000))
    # Devices with a window skip the packets outside of it.
    skipped = (steps > 1) & (steps % COLUMNS == 1) & (frames == 0)
    odd = int(np.count_nonzero(~(inner | turn | skipped)))
    holds = odd <= 0.01 * len(steps) and int(numbers.max()) < RESOLUTIONS[-1]
    picture = plot("column", "number", ("number", np.arange(len(numbers)), numbers))
    line = f"up to {int(numbers.max())}; {odd} of {len(steps)} out of order"
    return result(holds, line, picture)


@clause("ouster.timestamp", "Times of columns rise by even steps", OUSTER, OusterPackets)
def ouster_timestamp(topic: OusterPackets, recording: CheckedRecording) -> ClauseResult:
    """Within a packet, each valid column is one step later than the one before."""
    if len(topic.times) < 2 * COLUMNS:
        raise NotTested("fewer than 2 packets")
    steps = np.diff(topic.times.reshape(-1, COLUMNS), axis=1)
    valid = topic.is_valid.reshape(-1, COLUMNS)
    steps = steps[valid[:, 1:] & valid[:, :-1]]
    if len(steps) < COLUMNS:
        raise NotTested("hardly any valid column")
    usual = float(np.median(steps))
    even = float(np.mean(np.abs(steps - usual) < 0.2 * usual))
    back = int(np.count_nonzero(np.diff(topic.times[topic.is_valid]) < 0))
    holds = 1e4 < usual < 4e5 and even > 0.95 and back == 0
    picture = plot("column", "step, us", ("step", np.arange(len(steps)), steps / 1e3), dots=True)
    line = f"{usual / 1e3:.1f} us a column, {100 * even:.1f} % even, {back} back"
    return result(holds, line, picture)


@clause("ouster.valid", "Most columns are valid", OUSTER, OusterPackets)
def ouster_valid(topic: OusterPackets, recording: CheckedRecording) -> ClauseResult:
    """The status of columns is set. Packets at the ends of a window may be empty."""
    if not len(topic.is_valid):
        raise NotTested("no columns")
    share = float(np.mean(topic.is_valid))
    valid = topic.is_valid.reshape(-1, COLUMNS).sum(axis=1)
    picture = series_plot("valid columns", valid, each="packet")
    return result(share > 0.3, f"{100 * share:.1f} % valid", picture)


@clause(
    "ouster.imu",
    "Acceleration is in g, times rise",
    "Ouster Firmware User Manual: IMU data packet",
    OusterImuPackets,
)
def ouster_imu(topic: OusterImuPackets, recording: CheckedRecording) -> ClauseResult:
    """The median length of the acceleration is 1 g, readings are finite and later than before."""
    found = [f"packets of {length} bytes" for length in topic.wrong_lengths]
    if not len(topic.times):
        raise NotTested("no packets")
    lengths = np.linalg.norm(topic.acceleration, axis=1)
    median = float(np.median(lengths))
    picture = series_plot("|acceleration|, g", lengths, G_LIMITS, each="packet")
    if not G_LIMITS[0] < median < G_LIMITS[1]:
        found.append(f"acceleration {median:.3f} g")
    if not np.isfinite(topic.gyro).all():
        found.append("not finite")
    if back := int(np.count_nonzero(np.diff(topic.times) <= 0)):
        found.append(f"{back} times go back or repeat")
    return findings(found, f"{median:.3f} g, {len(topic.times)} packets", picture)
