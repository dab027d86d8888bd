# SPDX-License-Identifier: Apache-2.0
"""Start the node: ``python3 -m udp_bridge_ros1 [--bind HOST:PORT] [_peer:=HOST:PORT ...]``.

An invalid option or setting causes one error line and exit code 2. SIGINT and SIGTERM end the node
within a second. The node waits for a roscore, and ends with exit code 1 when roscore is restarted.
"""

from __future__ import annotations

import argparse
import signal
import sys
from typing import List, Optional

PROGRAM = "udp_bridge_ros1"
SWITCH_SECONDS = 5e-4
"""Interval of Python's thread switches. The default of 5 ms is several times the latency of a small
message."""


def main(argv: Optional[List[str]] = None) -> int:
    """Run the node until a signal ends it; return the exit code."""
    signals: List[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    sys.setswitchinterval(SWITCH_SECONDS)
    try:
        import rospy

        from udp_bridge.io.memory import keep_memory
        from udp_bridge.node.options import add_options

        from .master import MasterWatch, wait_for_master
        from .node import Ros1Node
    except ImportError as error:
        return _fail(f"{error}; it needs ROS 1 (Noetic) and the Python package udp-bridge")

    keep_memory()
    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(
        prog=PROGRAM, description="Publish in ROS 1 what arrives by UDP Bridge, and send back."
    )
    add_options(parser)
    arguments = parser.parse_args(rospy.myargv([PROGRAM, *argv])[1:])
    if not wait_for_master(lambda: bool(signals), _say):
        return 0
    try:
        rospy.init_node("udp_bridge", argv=[PROGRAM, *argv], disable_signals=True)
        node = Ros1Node(**vars(arguments))
    except OSError as error:
        return _fail(error.strerror or str(error))
    except (ValueError, rospy.ROSException) as error:
        return _fail(str(error))
    watch = MasterWatch(rospy.get_name())
    while not (signals or watch.is_another or rospy.is_shutdown()):
        node.turn()
    watch.close()
    node.close()
    if watch.is_another:
        _say("roscore was restarted. Fix: start this node again")
    elif not signals:
        _say("another node took this node's name. Fix: give one of them another by __name:=NAME")
    rospy.signal_shutdown("signal received")
    return 0 if signals else 1


def _say(line: str) -> None:
    print(f"{PROGRAM}: {' '.join(line.split())}", file=sys.stderr, flush=True)


def _fail(reason: str) -> int:
    _say(reason)
    return 2


if __name__ == "__main__":
    sys.exit(main())
