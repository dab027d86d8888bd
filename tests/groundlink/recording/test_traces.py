# SPDX-License-Identifier: Apache-2.0
"""Two traces are compared by value, and the first difference is that of the node that caused it."""

from collections.abc import Sequence
from pathlib import Path

from groundlink.messages.base import Command
from groundlink.recording.traces import TracedTopic, compare_traces, read_trace
from groundlink.ros.cdr import to_cdr
from udp_bridge.node.lockstep_trace import LockstepTrace

NODES = {"/target": "planner", "/cmd_vel": "controller"}
TWIST = "geometry_msgs/msg/Twist"
Lines = Sequence[tuple[int, str, float]]
"""Tick, topic and value of each message; /odom and /imu go to ROS."""

TICK = (
    (8, "/odom", 1.0),
    (8, "/target", 2.0),
    (8, "/cmd_vel", 3.0),
    (8, "/imu", 4.0),
)


def twist(value: float) -> bytes:
    return bytes(to_cdr(Command(0, (value, 0.0, 0.0), (0.0, 0.0, 0.0))))


def compared(folder: Path, *runs: Lines) -> list[TracedTopic]:
    traces = []
    for number, lines in enumerate(runs):
        file = folder / str(number)
        trace = LockstepTrace(str(file))
        for tick, topic, value in lines:
            if topic in NODES:
                trace.received(tick, topic, None, twist(value), TWIST)
            else:
                trace.published(tick, topic, tick * 1000, twist(value))
        trace.close()
        traces.append(read_trace(file, 100))
    return compare_traces(*traces, NODES)


def first(rows: Sequence[TracedTopic]) -> tuple[str, str | None, int, str]:
    found = rows[0].difference
    assert found
    return rows[0].topic, rows[0].node, found.number, found.words


def test_equal_runs_in_any_order_of_the_answers(tmp_path: Path) -> None:
    swapped = (TICK[0], TICK[2], TICK[1], TICK[3])
    rows = compared(tmp_path, TICK, (*swapped, (100, "/late", 0.0)))
    assert [(row.topic, row.first_run, row.second_run, row.equal) for row in rows] == [
        (topic, 1, 1, 1) for topic in ("/cmd_vel", "/imu", "/odom", "/target")
    ]
    assert not any(row.difference for row in rows)


def test_another_value_is_named_at_the_node_that_came_first(tmp_path: Path) -> None:
    other = (TICK[0], (8, "/cmd_vel", 3.5), (8, "/target", 2.5), (8, "/imu", 4.5))
    rows = compared(tmp_path, TICK, other)
    words = "linear.x: 2.0 in the first run, 2.5 in the second"
    assert first(rows) == ("/target", "planner", 1, words)
    assert [row.topic for row in rows] == ["/target", "/cmd_vel", "/imu", "/odom"]


def test_a_message_of_one_run_only(tmp_path: Path) -> None:
    rows = compared(tmp_path, TICK, (*TICK, (9, "/target", 0.0), (9, "/cmd_vel", 0.0)))
    assert first(rows) == ("/target", "planner", 2, "a message in the second run only")


def test_a_run_that_stands_still_lacks_an_answer(tmp_path: Path) -> None:
    rows = compared(tmp_path, TICK, TICK[:2])
    assert first(rows) == ("/cmd_vel", "controller", 1, "a message in the first run only")


def test_another_tick_is_a_difference(tmp_path: Path) -> None:
    later = (*TICK[:2], *TICK[3:], (9, "/cmd_vel", 3.0))
    words = "tick 8 in the first run, tick 9 in the second"
    assert first(compared(tmp_path, TICK, later)) == ("/cmd_vel", "controller", 1, words)


def test_padding_is_a_difference_only_where_the_type_is_unknown(tmp_path: Path) -> None:
    traces = []
    for padding in (b"\0\0", b"\7\7"):
        body = b"\0\1\0\0" + b"\2\0\0\0a\0" + padding + b"\2\0\0\0b\0"
        file = tmp_path / padding.hex()
        trace = LockstepTrace(str(file))
        trace.received(8, "/known", None, body, "diagnostic_msgs/msg/KeyValue")
        trace.received(8, "/unknown", None, body, "test_msgs/msg/Unknown")
        trace.close()
        traces.append(read_trace(file, 100))
    unknown, known = compare_traces(*traces, {})
    assert (unknown.topic, known.topic, known.difference) == ("/unknown", "/known", None)


def test_half_a_line_of_a_killed_node_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "trace"
    trace = LockstepTrace(str(file))
    trace.published(8, "/odom", 8, b"")
    trace.close()
    with file.open("ab") as lines:
        lines.write(b'{"direction": "to_')
    assert list(read_trace(file, 100)) == ["/odom"]
