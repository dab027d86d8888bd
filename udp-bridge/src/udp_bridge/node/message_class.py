# SPDX-License-Identifier: Apache-2.0
"""Classes of ROS messages, by the full name of their type; the same for ROS 1 and ROS 2.

A name may come from the network. Only packages that have a `msg` folder are imported, so that a
sender cannot have an arbitrary Python module imported.
"""

from __future__ import annotations

import os
from importlib import import_module
from importlib.util import find_spec
from typing import Any


class NotInstalled(ImportError):
    """A ROS type is not on this host; the text names the package to install."""


def message_class(ros_type: str) -> Any:
    """Return the class of a ROS type such as ``sensor_msgs/msg/Imu``.

    Raises
    ------
    NotInstalled
        When the package, or the type in it, is not installed.
    """
    package, _, name = ros_type.split("/")
    found = find_spec(package)
    folders = (found.submodule_search_locations or ()) if found else ()
    if not any(os.path.isdir(os.path.join(folder, "msg")) for folder in folders):
        distribution = os.environ.get("ROS_DISTRO", "DISTRO")
        raise NotInstalled(
            f"ROS package {package} is not installed. Fix: install"
            f" ros-{distribution}-{package.replace('_', '-')}, then start this node again"
        )
    module = import_module(f"{package}.msg")
    if not hasattr(module, name):
        raise NotInstalled(f"ROS package {package} has no message {name} in the installed version")
    return getattr(module, name)
