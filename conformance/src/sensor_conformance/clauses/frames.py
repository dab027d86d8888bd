# SPDX-License-Identifier: Apache-2.0
"""Frames and transforms: names, tree, order of REP 105, optical frames of REP 103."""

import re
from itertools import pairwise

import numpy as np

from sensor_conformance.readings.base import TopicReadings
from sensor_conformance.readings.image import CameraInfoReadings, ImageReadings
from sensor_conformance.readings.recording import CheckedRecording
from sensor_conformance.readings.transforms import TransformReadings
from sensor_conformance.report.plot import named_plot, plot
from sensor_conformance.signals.rotations import normalized, product, rotate

from .clause import ClauseResult, NotTested, clause, findings, result
from .stamps import PERIODIC

REP_105 = ("earth", "map", "odom", "base_link")
"""Frames of REP 105 from the root downwards. `base_footprint` may stand above `base_link`."""

MOST_JUMP = 0.5
"""Meters that a frame may move between two transforms beyond what its speed explains."""


@clause("frames.set", "Every message names one frame", "std_msgs/Header: frame_id", *PERIODIC)
def is_set(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """A sensor has one frame."""
    names = list(topic.frames)
    if names == [""] and topic.type == "sensor_msgs/msg/JointState":
        raise NotTested("a JointState has no frame")
    return result(len(names) == 1 and names[0] != "", f"frames: {', '.join(map(repr, names))}")


@clause("frames.slash", "Names of frames do not begin with a slash", "tf2: migration, frame ids")
def slash(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """Names are those of tf2, which knows no prefix."""
    names = set(topic.frames) | set(getattr(topic, "child_frames", {}))
    if isinstance(topic, TransformReadings):
        names |= {child for _, child in topic.edges}
    wrong = sorted(name for name in names if name.startswith("/"))
    return findings([f"{name!r}" for name in wrong], f"{len(names)} names")


@clause("frames.known", "tf knows the frame of every sensor", "REP 105", *PERIODIC)
def known(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """The frame of the header is one of the tree."""
    frames = recording.tree_of(topic).frames
    if not frames:
        raise NotTested("no transforms in the recording")
    names = {name for name in topic.frames if name}
    if not names:
        raise NotTested("no frame")
    if topic.type == "nav_msgs/msg/Odometry":
        names = set(getattr(topic, "child_frames", {}))
    missing = sorted(names - frames)
    return findings([f"{name!r} is not in tf" for name in missing], f"{', '.join(sorted(names))}")


@clause("frames.tree", "Frames form one tree", "REP 105: a frame has one parent", TransformReadings)
def tree(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """Each frame has one parent, and no frame is its own ancestor."""
    parents: dict[str, list[str]] = {}
    for parent, child in recording.tree_of(topic).edges:
        parents.setdefault(child, []).append(parent)
    found = [
        f"{child!r} has the parents {', '.join(map(repr, sorted(above)))}"
        for child, above in parents.items()
        if len(above) > 1
    ]
    for _, child in topic.edges:
        line = [child]
        while (above := parents.get(line[-1])) and above[0] not in line:
            line.append(above[0])
        if above:
            found.append(f"{child!r} is its own ancestor")
    return findings(found, f"{len(parents)} frames with a parent")


@clause("frames.connected", "All transforms belong to one tree", "REP 105", TransformReadings)
def connected(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """There is one root, or one for each robot whose frames have a prefix of their own."""
    tree = recording.tree_of(topic)
    roots = sorted({tree.line(frame)[-1] for frame in tree.frames})
    prefixes = {root.rpartition("/")[0] for root in roots}
    holds = len(roots) == 1 or (len(prefixes) == len(roots) and "" not in prefixes)
    return result(holds, f"roots: {', '.join(roots)}")


@clause("frames.order", "Frames stand in the order of REP 105", "REP 105", TransformReadings)
def order(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """Map is above odom, odom above base_link."""
    tree = recording.tree_of(topic)
    prefixes = {frame[: -len(REP_105[-1])] for frame in tree.frames if frame.endswith(REP_105[-1])}
    found, lines = [], []
    for prefix in sorted(prefixes):
        known = [prefix + name for name in REP_105 if prefix + name in tree.frames]
        lines += [" > ".join(known)] if len(known) > 1 else []
        for above, below in pairwise(known):
            if above not in tree.line(below)[1:]:
                found.append(f"{above!r} is not above {below!r}")
    if not lines:
        raise NotTested(f"fewer than two of {', '.join(REP_105)}")
    return findings(found, ", ".join(lines))


@clause(
    "frames.normalized",
    "Rotations are unit quaternions",
    "geometry_msgs/Quaternion; tf2 rejects others",
    TransformReadings,
)
def is_normalized(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """The length of each quaternion is 1, and all numbers are finite."""
    found, lengths = [], {}
    for (_, child), (_, translations, rotations) in topic.edges.items():
        off = float(np.max(np.abs(np.linalg.norm(rotations, axis=1) - 1)))
        lengths[child] = off
        if not off < 1e-3 or not np.isfinite(translations).all():
            found.append(f"{child!r}: length off by {off:.3g}")
    picture = named_plot("length of the quaternion off by", lengths, limits=(1e-3,))
    return findings(found, f"{len(topic.edges)} transforms", picture)


@clause(
    "frames.static",
    "Static transforms do not change",
    "tf2: /tf_static is latched",
    TransformReadings,
)
def static(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """All messages of a static transform are equal."""
    if not topic.is_static:
        raise NotTested("not a topic of static transforms")
    changes = {
        child: float(max(np.ptp(translations, axis=0).max(), np.ptp(rotations, axis=0).max()))
        for (_, child), (_, translations, rotations) in topic.edges.items()
    }
    found = [f"{child!r} moves" for child, change in changes.items() if change > 1e-6]
    picture = named_plot("largest change of a number", changes)
    return findings(found, f"{len(topic.edges)} transforms", picture)


@clause(
    "frames.increasing",
    "Stamps of a transform do not go back",
    "tf2: TF_OLD_DATA",
    TransformReadings,
)
def increasing(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """For each pair of frames, no stamp is earlier than the one before."""
    back = {
        f"{parent} to {child}": int(np.count_nonzero(np.diff(stamps) < 0))
        for (parent, child), (stamps, _, _) in topic.edges.items()
    }
    found = [f"{name}: {count} stamps go back" for name, count in back.items() if count]
    picture = named_plot(
        "stamps that go back",
        {child: count for (_, child), count in zip(topic.edges, back.values(), strict=True)},
    )
    return findings(found, f"{len(topic.edges)} transforms", picture)


@clause(
    "frames.continuous",
    "The frame odom moves the robot without jumps",
    "REP 105: odom is continuous",
    TransformReadings,
)
def continuous(topic: TransformReadings, recording: CheckedRecording) -> ClauseResult:
    """No step is longer than the speed before and after explains."""
    for (parent, child), (stamps, translations, _) in topic.edges.items():
        if parent.rpartition("/")[2] == "odom" and len(stamps) >= 5:
            steps = np.linalg.norm(np.diff(translations, axis=0), axis=1)
            worst = float(np.max(steps - np.median(steps)))
            picture = plot(
                "time, s",
                "step, m",
                (child, (stamps[1:] - stamps[0]) / 1e9, steps),
                limits=(float(np.median(steps)) + MOST_JUMP,),
            )
            return result(worst <= MOST_JUMP, f"longest step {np.max(steps):.3f} m", picture)
    raise NotTested("no transform from odom")


@clause(
    "frames.optical",
    "Optical frames have z forward, x right and y down",
    "REP 103: suffix frames",
    ImageReadings,
    CameraInfoReadings,
)
def optical(topic: TopicReadings, recording: CheckedRecording) -> ClauseResult:
    """An optical frame is turned against its body frame, or against the base, as REP 103 says."""
    frame = topic.frame
    if "optical" not in frame:
        raise NotTested(f"the frame {frame!r} is not named as an optical one")
    body = re.sub(r"_optical(_frame|_link)?$", "", frame)
    tree = recording.tree_of(topic)
    names = [name for name in (body, f"{body}_link", f"{body}_frame") if name != frame]
    for name in names:
        if name in tree.frames and (mount := tree.mount(frame, name)):
            half = np.array([-0.5, 0.5, -0.5, 0.5])
            off = product(normalized(mount[1]) * np.array([-1, -1, -1, 1.0]), half)
            angle = 2 * float(np.degrees(np.arccos(min(1.0, abs(off[3])))))
            picture = named_plot("degrees from z forward", {name: angle}, limits=(3.0,))
            line = f"{angle:.1f} degrees from z forward in {name!r}"
            return result(angle < 3, line, picture)
    mount = tree.mount(frame, recording.base_of(topic))
    if mount is None:
        raise NotTested(f"no static transform to {frame!r}")
    right = rotate(normalized(mount[1]), np.array([1.0, 0.0, 0.0]))
    down = rotate(normalized(mount[1]), np.array([0.0, 1.0, 0.0]))
    # A camera may look anywhere, but upright ones have x in the horizon and y below it.
    holds = abs(right[2]) < 0.5 and down[2] < 0.5
    picture = named_plot("upward part", {"x": float(right[2]), "y": float(down[2])}, limits=(0.5,))
    line = f"x points {right.round(2).tolist()}, y {down.round(2).tolist()} in the base"
    return result(holds, line, picture)
