# SPDX-License-Identifier: Apache-2.0
"""Writes the table of wire types into every file that repeats it: ``python -m tools.wire_types``.

The source is `udp_bridge.wire.types`. Each file has one block, between two marks, that is generated
here. A test compares the blocks and names the file to mend.
"""

import textwrap
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import NamedTuple

from udp_bridge.node.topic_qos import (
    QOS_BY_ROS_TYPE,
    STATIC_TRANSFORMS_TOPIC,
    TopicQos,
    publisher_qos,
)
from udp_bridge.wire.types import (
    ANY_ROS_TYPE,
    MSG_TYPES,
    NUMBER_OF_ROS_TYPE,
    ROS_TYPES,
    STAMP_ORDERED,
    MessageType,
)

ROOT = Path(__file__).resolve().parents[1]
ROWS = tuple(MSG_TYPES.values())
CSHARP = "udp-bridge/csharp/Runtime/UdpBridge"
CPP_NODE = "ros/udp_bridge_cpp/include/udp_bridge_cpp/wire/message_types.hpp"
NOT_IN_CSHARP = ("Resend", "Repair")
"""Types that the C# library does not take."""


class Block(NamedTuple):
    """A part of a file that repeats the table of types."""

    file: str
    begin: str
    """The line before the block, as it stands in the file."""
    end: str
    """What follows the block."""
    render: Callable[[], str]


def _protocol() -> str:
    return "".join(
        f"| {row.number} | {row.name} | {row.ros_type or '-'} | {row.default_topic or '-'}"
        f" | {row.direction} |\n"
        for row in ROWS
    )


def _lua() -> str:
    return "".join(
        f'    [{row.number}] = {{"{row.name}", "{row.ros_type or ""}", "{row.default_topic}"}},\n'
        for row in ROWS
    )


def _csharp() -> str:
    return "".join(
        f"        /// <summary>{_csharp_summary(row)}</summary>\n"
        f"        {row.name} = {row.number},\n"
        for row in ROWS
        if row.name not in NOT_IN_CSHARP
    )


def _csharp_summary(row: MessageType) -> str:
    if row.ros_type is None:
        return "The bridge's own."
    what = "Any ROS type, named in the body" if row.ros_type == ANY_ROS_TYPE else row.ros_type
    return f"{what}, {row.direction.replace('both', 'both ways')}."


def _cpp() -> str:
    return (
        "/// Whether a message of this type has a ROS type: its body is CDR.\n"
        + _cpp_switch("has_ros_type", ROS_TYPES)
        + "\n/// Whether PROTOCOL.md, section 4, has this type.\n"
        + _cpp_switch("is_in_table", MSG_TYPES)
        + "\n/// Whether a message older than the newest one of its topic is dropped as stale.\n"
        + _cpp_switch("is_stamp_ordered", STAMP_ORDERED)
    )


def _cpp_switch(name: str, numbers: Iterable[int]) -> str:
    cases = textwrap.wrap(" ".join(f"case_{n}:" for n in sorted(numbers)), 90)
    lines = "".join(f"    {line}\n".replace("case_", "case ") for line in cases)
    return (
        f"inline bool {name}(std::uint8_t type) {{\n  switch (type) {{\n{lines}"
        "      return true;\n    default:\n      return false;\n  }\n}\n"
    )


def _cpp_node() -> str:
    return "".join(
        f'    {{{row.number}, "{row.name}", "{row.ros_type}", "{row.default_topic}",\n'
        f"     {_cpp_qos(publisher_qos(row.name, row.default_topic))}}},\n"
        for row in ROWS
        if row.ros_type is not None
    )


def _cpp_qos(qos: TopicQos) -> str:
    numbers = f"{qos.depth}, {qos.waiting}, {qos.waiting_bytes}"
    return f"{{{numbers}, {str(qos.is_latched).lower()}, {str(qos.is_repeated).lower()}}}"


def _cpp_static_transforms() -> str:
    return f"    {_cpp_qos(publisher_qos('TFMessage', STATIC_TRANSFORMS_TOPIC))[1:-1]}\n"


def _cpp_qos_by_ros_type() -> str:
    rows = sorted(QOS_BY_ROS_TYPE.items())
    return "".join(f'    {{"{ros_type}", {_cpp_qos(qos)}}},\n' for ros_type, qos in rows)


def _scenario() -> str:
    names = sorted({*NUMBER_OF_ROS_TYPE} - {"rosgraph_msgs/msg/Clock"})
    return "".join(f'    "{name.replace("/msg/", "/")}",\n' for name in names)


BLOCKS = (
    Block(
        "udp-bridge/PROTOCOL.md",
        "| msg_type | name | ROS type | default topic | direction |\n|---|---|---|---|---|\n",
        "\n",
        _protocol,
    ),
    Block("udp-bridge/wireshark/udp_bridge.lua", "local TYPES = {\n", "}\n", _lua),
    Block(
        f"{CSHARP}/Wire/MessageType.cs",
        "    public enum MessageType : byte\n    {\n",
        "    }\n",
        _csharp,
    ),
    Block(
        f"{CSHARP}/Receiving/ReceivedTopic.cs",
        "        private static readonly int[] StampOrdered =\n        {\n",
        "        };\n",
        lambda: f"            {', '.join(map(str, sorted(STAMP_ORDERED)))},\n",
    ),
    Block(
        "udp-bridge/cpp/udp_bridge.hpp",
        "// Generated from wire/types.py by `python -m tools.wire_types`.\n",
        "// End of the generated part.\n",
        _cpp,
    ),
    Block(CPP_NODE, "inline constexpr MessageType kMessageTypes[] = {\n", "};\n", _cpp_node),
    Block(
        CPP_NODE,
        "inline constexpr TopicQos kStaticTransforms = {\n",
        "};\n",
        _cpp_static_transforms,
    ),
    Block(
        CPP_NODE,
        "inline constexpr RosTypeQos kQosByRosType[] = {\n",
        "};\n",
        _cpp_qos_by_ros_type,
    ),
    Block("groundlink/scenario/ros_side.py", "RosType = Literal[\n", "]\n", _scenario),
)


def updated(block: Block) -> str:
    """Return a file's text with its block as it should be."""
    text = (ROOT / block.file).read_text(encoding="utf-8")
    begin = text.index(block.begin) + len(block.begin)
    end = begin if text.startswith(block.end, begin) else text.index("\n" + block.end, begin) + 1
    return text[:begin] + block.render() + text[end:]


def main() -> None:
    """Write all blocks."""
    for block in BLOCKS:
        (ROOT / block.file).write_text(updated(block), encoding="utf-8")


if __name__ == "__main__":
    main()
