# SPDX-License-Identifier: Apache-2.0
"""Layout of images, and calibration: sensor_msgs/Image, sensor_msgs/CameraInfo, REP 118."""

import numpy as np

from sensor_conformance.readings.image import ENCODINGS, CameraInfoReadings, ImageReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.report.plot import count_plot, named_plot, plot

from .clause import ClauseResult, NotTested, clause, findings, result

DEFINITION = "sensor_msgs/CameraInfo"
COEFFICIENTS = {
    "plumb_bob": (5,),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
    "fisheye": (4,),
    "thin_prism": (8,),
    "": (0,),
}
"""Lengths of D for each model of sensor_msgs/distortion_models.hpp and of drivers."""


def _space(topic: ImageReadings | CameraInfoReadings) -> str:
    name = topic.name.removesuffix("/compressed").removesuffix("/compressedDepth")
    return name.rpartition("/")[0]


def _info_of(topic: ImageReadings, recording: CheckedRecording) -> CameraInfoReadings:
    for info in recording.of(CameraInfoReadings):
        if _space(info) == _space(topic) and len(info.stamps):
            return info
    raise NotTested(f"no camera_info in the namespace {_space(topic)!r}")


@clause(
    "image.encoding",
    "The encoding is a known one",
    "sensor_msgs/image_encodings.hpp",
    ImageReadings,
)
def encoding(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """Encodings stand in the list; formats of compressed images name a codec."""
    found = []
    for name in sorted({header.encoding for header in topic.headers}):
        codecs = ("jpeg", "jpg", "png", "tiff", "compressedDepth", "h264", "h265", "rvl")
        if topic.is_raw and name not in ENCODINGS:
            found.append(f"{name!r} is unknown")
        if not topic.is_raw and not any(codec.lower() in name.lower() for codec in codecs):
            found.append(f"{name!r} names no codec")
    return findings(found, ", ".join(sorted({header.encoding for header in topic.headers})))


@clause(
    "image.size",
    "The data are as long as height, width and step say",
    "sensor_msgs/Image",
    ImageReadings,
)
def size(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """The length is step times height, and a row holds the pixels."""
    if not topic.is_raw:
        raise NotTested("compressed")
    found = []
    for name, height, width, step, length in sorted(set(topic.headers)):
        kind, channels = ENCODINGS.get(name, ("u1", 1))
        row = np.dtype(kind).itemsize * channels * width
        if length != step * height:
            found.append(f"{length} bytes, {step} x {height} = {step * height} expected")
        if step < row:
            found.append(f"step {step}, a row of {width} {name} has {row}")
    count = np.arange(len(topic.headers))
    picture = plot(
        "image",
        "bytes",
        ("data", count, np.array([one.length for one in topic.headers])),
        ("step x height", count, np.array([one.step * one.height for one in topic.headers])),
    )
    return findings(found, f"{len(set(topic.headers))} layouts", picture)


@clause("image.decodes", "Every image can be decoded", "sensor_msgs/CompressedImage", ImageReadings)
def decodes(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """No data are broken."""
    if not topic.is_raw and topic.undecoded == len(topic.headers):
        raise NotTested("the codec is not known here, or Pillow is missing")
    picture = count_plot("images that fail", np.array(topic.fails), each="image")
    line = f"{topic.undecoded} of {len(topic.headers)} fail"
    return result(topic.undecoded == 0, line, picture)


@clause(
    "camera.info_size", "CameraInfo is that of the image: size and frame", DEFINITION, ImageReadings
)
def info_size(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """Both have the same size and frame."""
    info = _info_of(topic, recording)
    sizes = {(one.height, one.width) for one in topic.headers if one.height}
    found = []
    if sizes and sizes != info.sizes:
        found.append(f"images {sorted(sizes)}, camera_info {sorted(info.sizes)}")
    if set(topic.frames) != set(info.frames):
        found.append(f"image in {topic.frame!r}, camera_info in {info.frame!r}")
    edges = {
        f"{name} {edge}": float(size)
        for name, known in (("image", sizes), ("camera_info", info.sizes))
        for edge, size in zip(("height", "width"), min(known, default=()), strict=False)
    }
    return findings(found, f"{sorted(info.sizes)} in {info.frame!r}", named_plot("pixels", edges))


@clause(
    "camera.info_stamp",
    "Every image has a CameraInfo of the same stamp",
    "image_transport: CameraSubscriber matches equal stamps",
    ImageReadings,
)
def info_stamp(topic: ImageReadings, recording: CheckedRecording) -> ClauseResult:
    """All but the first and last images find their camera_info."""
    info = _info_of(topic, recording)
    if len(topic.stamps) < 4:
        raise NotTested("fewer than 4 images")
    without = ~np.isin(topic.stamps[1:-1], info.stamps)
    missing = int(np.count_nonzero(without))
    picture = count_plot("images without camera_info", without, each="image")
    line = f"{missing} of {len(topic.stamps)} have none"
    return result(missing <= 0.02 * len(topic.stamps), line, picture)


@clause(
    "camera.matrix", "K and P are matrices of a camera of this size", DEFINITION, CameraInfoReadings
)
def matrix(topic: CameraInfoReadings, recording: CheckedRecording) -> ClauseResult:
    """Focal lengths are positive, the principal point lies in the image, the last row is 0 0 1."""
    height, width = min(topic.sizes)
    k, p = topic.k, topic.p
    if not k.any():
        raise NotTested("not calibrated: K is zero")
    found = []
    if k[0, 0] <= 0 or k[1, 1] <= 0:
        found.append(f"focal lengths {k[0, 0]:g}, {k[1, 1]:g}")
    if not (0.1 * width < k[0, 2] < 0.9 * width and 0.1 * height < k[1, 2] < 0.9 * height):
        found.append(f"principal point {k[0, 2]:g}, {k[1, 2]:g} of {width} x {height}")
    if not np.allclose(k[2], (0, 0, 1)) or k[1, 0] != 0:
        found.append("K is no matrix of a camera")
    if not (0.1 * width < k[0, 0] < 50 * width):
        found.append(f"fx {k[0, 0]:g} for {width} columns")
    if p.any() and (not np.allclose(p[2], (0, 0, 1, 0)) or p[0, 0] <= 0):
        found.append("P is no projection")
    values = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]}
    picture = named_plot("pixels", {**values, "width": width, "height": height})
    line = f"fx {k[0, 0]:.1f}, fy {k[1, 1]:.1f}, {width} x {height}"
    return findings(found, line, picture)


@clause(
    "camera.distortion",
    "D has as many coefficients as its model",
    "sensor_msgs/distortion_models.hpp",
    CameraInfoReadings,
)
def distortion(topic: CameraInfoReadings, recording: CheckedRecording) -> ClauseResult:
    """Known models have their number of coefficients."""
    model = min(topic.models)
    if model not in COEFFICIENTS:
        return result(False, f"model {model!r} is unknown")
    if not topic.k.any():
        raise NotTested("not calibrated: K is zero")
    holds = len(topic.d) in (*COEFFICIENTS[model], 0) and np.isfinite(topic.d).all()
    picture = named_plot("D", {str(index): float(one) for index, one in enumerate(topic.d)})
    return result(bool(holds), f"{len(topic.d)} coefficients of {model!r}", picture)


@clause("camera.rectification", "R is a rotation", DEFINITION, CameraInfoReadings)
def rectification(topic: CameraInfoReadings, recording: CheckedRecording) -> ClauseResult:
    """R is orthonormal and right-handed."""
    if not topic.r.any():
        raise NotTested("not calibrated: R is zero")
    off = float(np.abs(topic.r @ topic.r.T - np.eye(3)).max())
    turned = float(np.linalg.det(topic.r))
    picture = named_plot("R", {"off by": off, "determinant": turned})
    line = f"off by {off:.2g}, determinant {turned:.3f}"
    return result(off < 1e-3 and turned > 0, line, picture)


@clause(
    "camera.baseline",
    "P of a right camera has a negative Tx",
    f"{DEFINITION}: Tx = -fx' * B",
    CameraInfoReadings,
)
def baseline(topic: CameraInfoReadings, recording: CheckedRecording) -> ClauseResult:
    """Of a stereo pair, P[3] is zero on the left and -fx * baseline on the right."""
    side = _space(topic).rpartition("/")[2]
    if side not in ("left", "right"):
        raise NotTested("not one of a stereo pair")
    shift = float(topic.p[0, 3])
    holds = shift == 0 if side == "left" else shift < 0
    meters = -shift / topic.p[0, 0] if topic.p[0, 0] else float("nan")
    picture = named_plot("m", {"baseline": meters}, limits=(0.0,))
    return result(holds, f"Tx {shift:.3f}: baseline {meters:.4f} m", picture)
