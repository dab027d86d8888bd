# SPDX-License-Identifier: Apache-2.0
"""Mounts of a run's sensors, from its recording. No estimator gets them."""

from pathlib import Path
from typing import Any

from mcap.reader import make_reader

from groundlink.ros.streams import TF_STATIC_TOPIC
from groundlink.ros.types import STORE


def frames_of(recording: Path) -> dict[str, list[float]]:
    """Return base_from_frame of each sensor's frame: x, y, z, qx, qy, qz, qw."""
    found = {}
    with recording.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages([TF_STATIC_TOPIC]):
            tree: Any = STORE.deserialize_cdr(message.data, "tf2_msgs/msg/TFMessage")
            for link in tree.transforms:
                t, q = link.transform.translation, link.transform.rotation
                found[link.child_frame_id] = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
    return found
