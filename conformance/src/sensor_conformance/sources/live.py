# SPDX-License-Identifier: Apache-2.0
"""Topics of a running ROS 2 system, recorded into memory. The only module that imports rclpy."""

from collections.abc import Iterator, Sequence
from importlib import import_module
from time import monotonic, time_ns
from typing import Any

from .source import Received, SourceTopic, UnreadableSource

LOOK_EVERY = 0.5
"""Seconds between two looks for new topics."""


class LiveSource:
    """Topics of a running ROS 2 system, subscribed to for some seconds.

    Parameters
    ----------
    duration
        Seconds of wall time to listen.

    Raises
    ------
    UnreadableSource
        If rclpy can't be imported.
    """

    name = "live topics"

    def __init__(self, duration: float) -> None:
        try:
            import rclpy
        except ImportError as error:
            raise UnreadableSource(f"rclpy not found ({error}). Fix: source ROS 2") from error
        self._received: dict[SourceTopic, list[Received]] = {}
        self._unread: dict[str, UnreadableSource] = {}
        with rclpy.init():
            node = rclpy.create_node("sensor_conformance")
            start = monotonic()
            looks = 0
            while (passed := monotonic() - start) < duration:
                if passed >= looks * LOOK_EVERY:
                    looks += 1
                    self._subscribe(node)
                rclpy.spin_once(node, timeout_sec=0.1)
            node.destroy_node()

    def topics(self) -> Sequence[SourceTopic]:
        """Return all topics that had a publisher."""
        return tuple(self._received)

    def messages(self, topic: str) -> Iterator[Received]:
        """Yield the messages of a topic in the order of their arrival."""
        if topic in self._unread:
            raise self._unread[topic]
        for known, messages in self._received.items():
            if known.name == topic:
                yield from messages

    def _subscribe(self, node: Any) -> None:
        """Subscribe to the topics that have a publisher and are new."""
        from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

        for name, types in node.get_topic_names_and_types():
            topic = SourceTopic(name, types[0])
            publishers = node.get_publishers_info_by_topic(name)
            if topic in self._received or not publishers:
                continue
            kept = self._received[topic] = []
            latched = DurabilityPolicy.TRANSIENT_LOCAL
            is_latched = all(one.qos_profile.durability == latched for one in publishers)
            profile = QoSProfile(depth=100)
            profile.durability = latched if is_latched else DurabilityPolicy.VOLATILE
            # Any publisher serves a best-effort subscriber; latched messages need a reliable one.
            best_effort = ReliabilityPolicy.BEST_EFFORT
            profile.reliability = ReliabilityPolicy.RELIABLE if is_latched else best_effort

            def keep(message: Any, kept: list[Received] = kept) -> None:
                kept.append(Received(time_ns(), message))

            try:
                node.create_subscription(_type_of(topic), name, keep, profile)
            except UnreadableSource as error:
                self._unread[name] = error


def _type_of(topic: SourceTopic) -> Any:
    """Return the class of a message type.

    Raises
    ------
    UnreadableSource
        If its package is not installed.
    """
    package, folder, name = topic.type.split("/")
    try:
        return getattr(import_module(f"{package}.{folder}"), name)
    except ImportError as error:
        raise UnreadableSource(f"the package {package} is not found") from error
