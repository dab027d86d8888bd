# SPDX-License-Identifier: Apache-2.0
"""ROS 2 topics in an MCAP file, as rosbag2 writes them: definitions, encodings and QoS.

QoS policies are written as numbers, which every rosbag2 since Humble reads; the metadata record
`rosbag2` tells newer versions to expect numbers.
"""

from collections.abc import Mapping
from pathlib import Path

from groundlink.core import VERSION
from groundlink.ros.types import DEFINITION_ENCODING, MESSAGE_ENCODING, definition

from . import metadata
from .mcap_file import McapFile

PROFILE = "ros2"

ROSBAG2_METADATA = ("rosbag2", {"ROS_DISTRO": "kilted"})
"""ROS distribution of the definitions."""

_INFINITE = "{sec: 9223372036, nsec: 854775807}"

_VOLATILE, _TRANSIENT_LOCAL = 2, 1
"""rmw_qos_durability_policy_t."""


def _qos(durability: int, depth: int) -> str:
    """Return the profile of a publisher, keep last and reliable, as rosbag2 keeps it."""
    return f"""\
- history: 1
  depth: {depth}
  reliability: 1
  durability: {durability}
  deadline: {_INFINITE}
  lifespan: {_INFINITE}
  liveliness: 1
  liveliness_lease_duration: {_INFINITE}
  avoid_ros_namespace_conventions: false
"""


PLAIN_QOS = _qos(_VOLATILE, 10)
LATCHED_QOS = _qos(_TRANSIENT_LOCAL, 1)
"""QoS of latched topics."""


class RosFile:
    """An MCAP file of the profile `ros2`, open for messages.

    Parameters
    ----------
    path
        path of the new file.

    Raises
    ------
    FileExistsError
        when there is a file.
    """

    def __init__(self, path: Path) -> None:
        self.mcap = McapFile(path, profile=PROFILE, library=f"groundlink {VERSION}")
        self.mcap.add_metadata(*ROSBAG2_METADATA)
        self._schemas: dict[str, int] = {}
        self._topics: dict[tuple[str, str], RecordedTopic] = {}

    def topic(self, name: str, ros_type: str, *, latched: bool = False) -> "RecordedTopic":
        """Return the topic of a name and type, declared at the first call."""
        known = self._topics.get((name, ros_type))
        if known is None:
            if ros_type not in self._schemas:
                text = definition(ros_type).encode()
                self._schemas[ros_type] = self.mcap.add_schema(ros_type, DEFINITION_ENCODING, text)
            qos = LATCHED_QOS if latched else PLAIN_QOS
            channel = self.mcap.add_channel(
                name, self._schemas[ros_type], MESSAGE_ENCODING, {"offered_qos_profiles": qos}
            )
            known = self._topics[name, ros_type] = RecordedTopic(self.mcap, channel, name, ros_type)
        return known

    def topics(self) -> list["RecordedTopic"]:
        """Return all topics in order of declaration."""
        return list(self._topics.values())

    @property
    def size_bytes(self) -> int:
        """Size of the committed file."""
        return self.mcap.size_bytes

    def commit(self, declared_hz: Mapping[str, float | None]) -> None:
        """Commit all written messages; rates are by topic.

        Raises
        ------
        OSError
            when it cannot be written.
        """
        topics = {
            topic.name: metadata.TopicFacts(
                type=topic.ros_type,
                messages=topic.messages,
                first_nanos=topic.first_nanos,
                last_nanos=topic.last_nanos,
                declared_hz=declared_hz.get(topic.name),
            )
            for topic in self.topics()
        }
        self.mcap.commit(metadata.TOPICS_RECORD, metadata.topic_entries(topics))

    def add_journal(self, nanos: int, part: bytes) -> None:
        """Attach a part of the run's journal."""
        self.mcap.add_attachment(
            metadata.JOURNAL_ATTACHMENT, "application/octet-stream", nanos, part
        )

    def add_checkpoint(self, nanos: int, checkpoint: bytes) -> None:
        """Attach a checkpoint of the run."""
        self.mcap.add_attachment(
            metadata.CHECKPOINT_ATTACHMENT, "application/octet-stream", nanos, checkpoint
        )

    def end(self, nanos: int) -> None:
        """Record that the file is complete up to a stamp."""
        self.mcap.add_metadata(metadata.END_RECORD, {"nanos": str(nanos)})

    def lacks(self, dropped: Mapping[str, int]) -> None:
        """Record the number of dropped messages of each topic."""
        entries = {topic: str(count) for topic, count in dropped.items()}
        self.mcap.add_metadata(metadata.DROPPED_RECORD, entries)

    def close(self) -> None:
        """Close the file as the last commit left it."""
        self.mcap.close()


class RecordedTopic:
    """A topic of the file with its statistics."""

    def __init__(self, mcap: McapFile, channel: int, name: str, ros_type: str) -> None:
        self._mcap = mcap
        self._channel = channel
        self.name = name
        self.ros_type = ros_type
        self.messages = 0
        self.first_nanos = 0
        self.last_nanos = 0

    def write(self, nanos: int, cdr: memoryview) -> None:
        """Append a message; times of a topic never decrease."""
        nanos = max(nanos, self.last_nanos)
        if not self.messages:
            self.first_nanos = nanos
        self.messages += 1
        self.last_nanos = nanos
        self._mcap.write(self._channel, nanos, self.messages, cdr)
