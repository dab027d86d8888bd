# SPDX-License-Identifier: Apache-2.0
"""The poses of all bodies as a ROS message of a standard type, and back: tf2_msgs/TFMessage.

Rule: a transform for each body, in the order of their numbers, all of one instant and out of the
world. It is no part of the tf tree: no frame in it is a sensor's or a stack's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from groundlink.messages.base import packed
from groundlink.messages.ground_truth import WORLD_FRAME, Bodies

from .types import TYPES, header, nanos, quaternion, vector, xyz, xyzw


def bodies(message: Bodies) -> dict[str, Any]:
    """Return the fields of tf2_msgs/TFMessage."""
    stamped = TYPES["geometry_msgs/msg/TransformStamped"]
    transform = TYPES["geometry_msgs/msg/Transform"]
    of_all = header(message.stamp_nanos, WORLD_FRAME)
    return {
        "transforms": [
            stamped(
                header=of_all,
                child_frame_id=name,
                transform=transform(translation=vector(pose[:3]), rotation=quaternion(pose[3:])),
            )
            for name, pose in zip(message.names, message.world_from_body().tolist(), strict=True)
        ]
    }


def from_bodies(ros: Any) -> Bodies:
    """Return the poses that a tf2_msgs/TFMessage was filled with.

    Raises
    ------
    ValueError
        when there are none.
    """
    if not ros.transforms:
        raise ValueError("no transform in it, expected one for each body")
    poses = [
        (*xyz(one.transform.translation), *xyzw(one.transform.rotation)) for one in ros.transforms
    ]
    return Bodies(
        nanos(ros.transforms[0].header.stamp),
        tuple(one.child_frame_id for one in ros.transforms),
        packed(np.array(poses)),
    )
