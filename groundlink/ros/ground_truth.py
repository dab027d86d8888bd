# SPDX-License-Identifier: Apache-2.0
"""Codec of the poses of all bodies as tf2_msgs/TFMessage.

The message has a transform from the world for each body, in the order of body numbers, all with the
same stamp. These transforms are not in the tf tree: their frames are neither a sensor's nor a
stack's.
"""

from typing import Any

import numpy as np

from groundlink.messages.base import packed
from groundlink.messages.ground_truth import WORLD_FRAME, Bodies

from .codec import Codec, Moment
from .types import TYPES, header, nanos, quaternion, vector, xyz, xyzw


def _bodies(message: Bodies) -> dict[str, Any]:
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


def _bodies_of(ros: Any, moment: Moment) -> Bodies:
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


CODECS = (Codec(Bodies, "tf2_msgs/msg/TFMessage", _bodies, _bodies_of),)
