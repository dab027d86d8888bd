# SPDX-License-Identifier: Apache-2.0
import base64
import hashlib
import json
from pathlib import Path

from udp_bridge.node.lockstep_trace import LockstepTrace


def test_a_line_for_each_message_and_none_after_the_end(tmp_path: Path) -> None:
    file = tmp_path / "trace"
    trace = LockstepTrace(str(file))
    trace.published(8, "/odom", 20_000_000, memoryview(b"odometry"))
    trace.received(8, "/cmd_vel", None, b"twist", "geometry_msgs/msg/Twist")
    trace.close()
    trace.published(16, "/odom", 40_000_000, b"late")
    digests = [hashlib.sha256(body).hexdigest() for body in (b"odometry", b"twist")]
    assert [json.loads(line) for line in file.read_text().splitlines()] == [
        {
            "direction": "to_ros",
            "tick": 8,
            "topic": "/odom",
            "stamp_nanos": 20_000_000,
            "sha256": digests[0],
        },
        {
            "direction": "from_ros",
            "tick": 8,
            "topic": "/cmd_vel",
            "stamp_nanos": None,
            "sha256": digests[1],
            "type": "geometry_msgs/msg/Twist",
            "body": base64.b64encode(b"twist").decode(),
        },
    ]
