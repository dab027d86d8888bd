# SPDX-License-Identifier: Apache-2.0
"""Commands of joints from ROS: JointState, and the Float64MultiArray of a group of joints.

On the bus, both are a JointState with a value per name, NaN for a joint that a quantity does not
command.
"""

from collections.abc import Sequence
from typing import Any, get_args

import numpy as np

from groundlink.messages.base import BadBusMessage, packed
from groundlink.messages.navigation import JointState
from groundlink.scenario.joints import JointInterface, Quantity

from .codec import checked_name

MULTI_ARRAY = "std_msgs/msg/Float64MultiArray"

Values = Sequence[float]


def joint_command(names: Sequence[str], quantities: Sequence[Values], now_nanos: int) -> JointState:
    """Return a command of joints, valid from `now_nanos`.

    Parameters
    ----------
    quantities
        positions, velocities and efforts, each with a value per name or without any.
    """
    arrays = [np.asarray(values, np.float64) for values in quantities]
    if any(len(array) not in {0, len(names)} for array in arrays):
        sizes = ", ".join(str(len(array)) for array in arrays)
        raise BadBusMessage(f"{len(names)} joints with {sizes} positions, velocities, efforts")
    if any(np.isinf(array).any() for array in arrays):
        raise BadBusMessage("a value is infinite")
    if all(np.isnan(array).all() for array in arrays):
        raise BadBusMessage("no joint gets a value")
    positions, velocities, efforts = map(packed, arrays)
    return JointState(
        now_nanos, "", tuple(map(checked_name, names)), positions, velocities, efforts
    )


def read_joint_state(ros: Any, now_nanos: int, joints: Sequence[JointInterface]) -> JointState:
    """Return a command of a vehicle's joints.

    A quantity has a value per name, or a value per name that ros2_control commands by it:
    `topic_based_ros2_control` publishes the positions of steering joints and the velocities of
    wheels in one message like this.
    """
    command_of = {joint.name: joint.commands[0] for joint in joints}
    quantities = []
    for quantity in get_args(Quantity):
        values = getattr(ros, quantity)
        places = [i for i, name in enumerate(ros.name) if command_of.get(name) == quantity]
        if len(values) not in {0, len(ros.name)} and len(values) == len(places):
            spread = np.full(len(ros.name), np.nan)
            spread[places] = values
            values = spread
        quantities.append(values)
    return joint_command(ros.name, quantities, now_nanos)


def read_joint_group(ros: Any, now_nanos: int, joints: Sequence[JointInterface]) -> JointState:
    """Return a command of a group: values in the order of its joints, all of one quantity."""
    if len(ros.data) != len(joints):
        raise BadBusMessage(f"{len(ros.data)} values for a group of {len(joints)} joints")
    wanted = joints[0].commands[0]
    quantities = [ros.data if quantity == wanted else () for quantity in get_args(Quantity)]
    return joint_command([joint.name for joint in joints], quantities, now_nanos)
