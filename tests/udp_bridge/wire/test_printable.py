# SPDX-License-Identifier: Apache-2.0
import logging

import pytest

from udp_bridge.node.log import Log
from udp_bridge.wire.printable import printable


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("/odom: nav_msgs/msg/Odometry, größer", "/odom: nav_msgs/msg/Odometry, größer"),
        ("/a\n[INFO] all is well", "/a\\n[INFO] all is well"),
        ("\x1b[2K\r", "\\x1b[2K\\r"),
        ("\u202e\u2028\ud800", "\\u202e\\u2028\\ud800"),
        ("\\n", "\\\\n"),
    ],
)
def test_no_name_begins_a_line_or_moves_the_cursor(text: str, shown: str) -> None:
    assert printable(text) == shown


def test_a_node_escapes_whatever_it_logs(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    log = Log(logging.getLogger(__name__))
    log.info("a\nb")
    log.warning("c\x1bd")
    log.error("e\u2028f")
    assert caplog.messages == ["a\\nb", "c\\x1bd", "e\\u2028f"]
