# SPDX-License-Identifier: Apache-2.0
"""Labels of cameras reach ROS 2 as messages of vision_msgs, which `ros/vision_msgs` builds."""

import os
from pathlib import Path

import numpy as np
import pytest

from groundlink.messages.base import BusMessage, packed
from groundlink.messages.ground_truth import Detections2D, Detections3D, LabelTable
from groundlink.ros.cdr import CODECS, from_cdr, to_cdr
from groundlink.ros.codec import Moment
from udp_bridge.wire.typed import pack_typed
from udp_bridge.wire.types import TYPED

from .conftest import LATCHED, RELIABLE, FarEnd, Ros
from .interfaces import VISION_MSGS, built

ONE = (packed(np.array([20], np.uint16)), packed(np.array([0.25])))
MESSAGES: dict[str, BusMessage] = {
    "label_info": LabelTable(0, "cam", ("person",), packed(np.array([20], np.uint16))),
    "boxes_2d": Detections2D(0, "cam", ("anna",), *ONE, packed(np.array([8.0, 6.0, 4.0, 2.0]))),
    "boxes_3d": Detections3D(0, "cam", ("anna",), *ONE, packed(np.arange(10.0))),
}


def test_labels_are_typed_messages_in_ros(ros: Ros, pytestconfig: pytest.Config) -> None:
    folder = built(VISION_MSGS, Path(pytestconfig.cache.mkdir("interfaces")))  # type: ignore[union-attr]
    ros.environment["PYTHONPATH"] += os.pathsep + str(folder)
    _, address = ros.bridge()
    far_end = FarEnd(address)
    types = {name: CODECS[type(message)].ros_type for name, message in MESSAGES.items()}
    # vision_msgs asks for a latched table; boxes are as any other reading.
    listener = ros.listen(
        *(
            (ros_type, f"/labels/{name}", LATCHED if name == "label_info" else RELIABLE)
            for name, ros_type in types.items()
        )
    )
    for name, message in MESSAGES.items():
        cdr = bytes(to_cdr(message))
        far_end.reach(listener, TYPED, f"/labels/{name}", pack_typed(types[name], cdr))
        came = bytes.fromhex(listener.messages(f"/labels/{name}")[0][1])
        # DDS leaves gaps between numbers as they are in memory.
        assert from_cdr(came[: len(cdr)], type(message), Moment(0, 0)) == message
    far_end.close()
