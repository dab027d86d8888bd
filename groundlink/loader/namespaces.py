# SPDX-License-Identifier: Apache-2.0
"""ROS namespaces of vehicles: a namespace for topics and a prefix for tf frames.

As in ROS, a topic that begins with a slash is absolute; any other topic is in its vehicle's
namespace. A single vehicle has neither namespace nor prefix. With several vehicles both default to
the vehicle's name.
"""

import re

from groundlink.loader.document import DataPath, Document, ScenarioError
from groundlink.loader.validation_errors import dotted
from groundlink.scenario.schema import NAMESPACE

COMMAND_TOPIC = "cmd_vel"

_TOPICS_AS_KEYS = ("from_ros", "topics"), ("from_ros", "joint_groups")
"""Ends of the paths of fields whose keys are topics."""


def into_namespaces(document: Document) -> None:
    """Give every vehicle its namespace and prefix, and every topic of it its full name.

    Raises
    ------
    ScenarioError
        when a namespace is none.
    """
    vehicles = document.at(("vehicles",))
    if not isinstance(vehicles, list):
        return
    for v, vehicle in enumerate(vehicles):
        if not isinstance(vehicle, dict):
            continue
        name = vehicle.get("name") if len(vehicles) > 1 else None
        vehicle.setdefault("namespace", f"/{name}" if name else "")
        vehicle.setdefault("frame_prefix", f"{name}/" if name else "")
        vehicle.setdefault("command_topic", COMMAND_TOPIC)
        namespace = vehicle["namespace"]
        if not re.fullmatch(NAMESPACE, str(namespace)):
            here: DataPath = ("vehicles", v, "namespace")
            raise ScenarioError(
                f"{document.mark(here)}: `{dotted(here)}`: expected words with a slash before "
                f"each, such as /fleet/rover (given: {namespace!r})"
            )
        _absolute(document, ("vehicles", v), namespace)


def _absolute(document: Document, path: DataPath, namespace: str) -> None:
    """Write topics in full, at a place and in all that is in it."""
    value = document.at(path)
    if path[-2:] in _TOPICS_AS_KEYS and isinstance(value, dict):
        _further(document, path, namespace)
    elif isinstance(value, dict):
        for key in value:
            _absolute(document, (*path, key), namespace)
    elif isinstance(value, list):
        for index in range(len(value)):
            _absolute(document, (*path, index), namespace)
    elif isinstance(value, str) and _is_topic(path) and not value.startswith("/"):
        document.at(path[:-1])[path[-1]] = f"{namespace}/{value}"


def _further(document: Document, path: DataPath, namespace: str) -> None:
    """Write topics that are keys in full, and types as ROS 1 has them."""
    full = {}
    for topic, ros_type in document.at(path).items():
        name = topic if topic.startswith("/") else f"{namespace}/{topic}"
        full[name] = ros_type.replace("/msg/", "/") if isinstance(ros_type, str) else ros_type
        document.marks[(*path, name)] = document.mark((*path, topic))
    document.at(path[:-1])[path[-1]] = full


def _is_topic(path: DataPath) -> bool:
    *_, holder, key = path
    return holder == "from_ros" or str(key) == "topic" or str(key).endswith("_topic")
