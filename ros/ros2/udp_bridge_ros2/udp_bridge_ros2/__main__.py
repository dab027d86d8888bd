# SPDX-License-Identifier: Apache-2.0
"""Start the node: ``python -m udp_bridge_ros2 [--bind HOST:PORT] [--ros-args ...]``.

An invalid option or setting causes one error line and exit code 2. SIGINT and SIGTERM end the node
within a second. rclpy is imported late, because DDS reads the environment when rclpy starts.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time

from .environment import apply_defaults
from .stale_shared_memory import SHARED_MEMORY, remove_leftovers

PROGRAM = "udp_bridge_ros2"
SWITCH_SECONDS = 5e-4
"""Interval of Python's thread switches. The default of 5 ms is several times the latency of a small
message."""


def main(argv: list[str] | None = None) -> int:
    """Run the node until a signal ends it; return the exit code."""
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    sys.setswitchinterval(SWITCH_SECONDS)
    apply_defaults(os.environ)
    remove_leftovers(SHARED_MEMORY, now_s=time.time())
    try:
        import rclpy
        from rclpy.exceptions import InvalidParameterTypeException
        from rclpy.signals import SignalHandlerOptions
        from rclpy.utilities import remove_ros_args

        from udp_bridge.io.memory import keep_memory
        from udp_bridge.node.options import add_options

        from .node import Ros2Node
    except ImportError as error:
        return _fail(f"{error}; it needs a ROS 2 environment and the Python package udp-bridge")

    keep_memory()
    argv = sys.argv[1:] if argv is None else argv
    parser = argparse.ArgumentParser(
        prog=PROGRAM, description="Publish in ROS 2 what arrives by UDP Bridge, and send back."
    )
    add_options(parser)
    try:
        arguments = parser.parse_args(remove_ros_args([PROGRAM, *argv])[1:])
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
        node = Ros2Node(**vars(arguments))
    except OSError as error:
        return _fail(error.strerror or str(error))
    except (ValueError, RuntimeError, InvalidParameterTypeException) as error:
        return _fail(str(error))
    while not signals:
        node.turn()
    node.close()
    rclpy.shutdown()
    return 0


def _fail(reason: str) -> int:
    print(f"{PROGRAM}: {' '.join(reason.split())}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
