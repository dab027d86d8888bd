# SPDX-License-Identifier: Apache-2.0
"""Content of images: exposure, sharpness, noise, gray levels; depth by REP 118."""

import numpy as np
from numpy.typing import NDArray

from sensor_conformance.readings.base import Floats
from sensor_conformance.readings.image import ImageReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, plot, series_plot, steps_plot

from .clause import ClauseResult, NotTested, clause, findings, result

DARKEST, BRIGHTEST = 8.0, 247.0
MOST_CLIPPED = 0.5
LEAST_EDGE = 0.045
"""Steepest gradient a pixel over the contrast. A Gaussian blur of 1 pixel has 0.4, of 10 pixels
0.04."""
LEAST_LEVELS = 0.4
"""Share of the levels between the 2nd and 98th percentile that occur."""
FARTHEST_DEPTH = 100.0


def _pictures(topic: ImageReadings) -> list[tuple[Floats, NDArray[np.int64]]]:
    if not topic.is_picture:
        raise NotTested("no pictures of 8 bits that can be decoded")
    return [(one.gray, one.levels) for _, one in topic.images.items]


@clause(
    "image.exposure",
    "Pictures are neither dark nor clipped",
    "EMVA 1288: saturation",
    ImageReadings,
)
def exposure(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """Means are inside the range, and few pixels are at its ends."""
    levels = np.array([levels for _, levels in _pictures(topic)], np.float64)
    shares = levels / levels.sum(axis=1, keepdims=True)
    means = shares @ np.arange(256)
    clipped = shares[:, 0] + shares[:, 255]
    picture = plot("gray level", "share of pixels", ("mean", np.arange(256), shares.mean(axis=0)))
    mean, most = float(np.median(means)), float(np.median(clipped))
    holds = DARKEST < mean < BRIGHTEST and most < MOST_CLIPPED
    return result(holds, f"mean {mean:.0f} of 255, {100 * most:.1f} % clipped", picture)


@clause(
    "image.sharpness", "Pictures are in focus", "EMVA 1288, ISO 12233: edge response", ImageReadings
)
def sharpness(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """The steepest edges are a few pixels wide."""
    edges = []
    for gray, _ in _pictures(topic):
        low, high = np.percentile(gray, (1, 99))
        if high - low >= 20:
            across = np.abs(gray[:, 2:] - gray[:, :-2]) / 2
            edges.append(float(np.percentile(across, 99.9)) / (high - low))
    if not edges:
        raise NotTested("pictures without contrast")
    sharp = float(np.median(edges))
    picture = plot(
        "image",
        "steepest edge",
        ("edge", np.arange(len(edges)), np.array(edges)),
        limits=(LEAST_EDGE,),
    )
    line = f"steepest edge {100 * sharp:.1f} % of the contrast a pixel"
    return result(sharp >= LEAST_EDGE, line, picture)


@clause(
    "image.alive", "Pictures change: there is noise", "EMVA 1288: temporal noise", ImageReadings
)
def alive(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """Successive images are not equal to the byte."""
    if not topic.is_picture or len(topic.checksums) < 3:
        raise NotTested("fewer than 3 pictures")
    repeats = np.diff(topic.checksums) == 0
    same = int(np.count_nonzero(repeats))
    picture = count_plot("repeated images", repeats, each="image")
    line = f"{same} repeat the one before to the byte"
    return result(same <= 0.02 * len(topic.checksums), line, picture)


@clause("image.levels", "Gray levels are not coarse", "EMVA 1288: quantization", ImageReadings)
def gray_levels(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """Most levels in the range of a picture occur."""
    shares = []
    for _, levels in _pictures(topic):
        total = np.cumsum(levels) / max(int(levels.sum()), 1)
        low, high = np.searchsorted(total, (0.02, 0.98))
        if high - low >= 30:
            shares.append(float(np.mean(levels[low : high + 1] > 0)))
    if not shares:
        raise NotTested("pictures without contrast")
    share = float(np.median(shares))
    first = _pictures(topic)[0][1]
    picture = plot("gray level", "pixels", ("first image", np.arange(256), first), dots=True)
    return result(share >= LEAST_LEVELS, f"{100 * share:.0f} % of the levels occur", picture)


@clause(
    "depth.units",
    "Depth is in meters as 32FC1, in millimeters as 16UC1",
    "REP 118: depth images",
    ImageReadings,
)
def depth_units(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """The median is that of a place where a robot can be."""
    values = _depths(topic)
    meters = values if topic.headers[0].encoding == "32FC1" else values / 1000
    good = meters[np.isfinite(meters) & (meters > 0)]
    if len(good) < 100:
        raise NotTested("hardly any depth")
    median = float(np.median(good))
    ranks = np.linspace(0, 1, 200)
    picture = plot("share below", "depth, m", ("depth", ranks, np.quantile(good, ranks)))
    return result(0.05 < median < FARTHEST_DEPTH, f"median {median:.3f} m", picture)


@clause(
    "depth.invalid",
    "Pixels without depth are NaN as 32FC1, 0 as 16UC1",
    "REP 118, REP 117: invalid, -inf too close, +inf too far",
    ImageReadings,
)
def depth_invalid(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """32FC1 holds no zero and nothing negative; 16UC1 no 65535 in number."""
    values = _depths(topic)
    found = []
    if topic.headers[0].encoding == "32FC1":
        zero = float(np.mean(values == 0))
        negative = float(np.mean((values < 0) & np.isfinite(values)))
        if zero or negative:
            found.append(f"{100 * zero:.2f} % zero, {100 * negative:.2f} % negative")
    else:
        share = float(np.mean(values == 65535))
        if share > 0.001:
            found.append(f"{100 * share:.2f} % are 65535")
    missing = float(np.mean(~np.isfinite(values) | (values == 0)))
    shares = [
        float(np.mean(~np.isfinite(one.gray) | (one.gray == 0))) for _, one in topic.images.items
    ]
    picture = series_plot("share without depth", np.array(shares), each="image that was kept")
    return findings(found, f"{100 * missing:.1f} % without depth", picture)


@clause(
    "depth.resolution",
    "Depth has the resolution of a device",
    "REP 118; data sheets",
    ImageReadings,
)
def depth_resolution(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """Below 3 m, neighboring values differ by less than 5 cm."""
    values = _depths(topic)
    meters = values if topic.headers[0].encoding == "32FC1" else values / 1000
    near = np.unique(meters[np.isfinite(meters) & (meters > 0.2) & (meters < 3)])
    if len(near) < 3:
        raise NotTested("hardly any depth below 3 m")
    step = float(np.percentile(np.diff(near), 50))
    picture = steps_plot("depth, m", near)
    return result(step <= 0.05, f"steps of {1e3 * step:.2f} mm", picture)


def _depths(topic: ImageReadings) -> Floats:
    if not topic.is_depth or not topic.images.items:
        raise NotTested("no depth image")
    return np.concatenate([one.gray.reshape(-1) for _, one in topic.images.items[:4]])
