# SPDX-License-Identifier: Apache-2.0
"""Log of a node. Lines are escaped, because they may hold names from the network."""

from __future__ import annotations

from typing import Any

from udp_bridge.wire.printable import printable


class Log:
    """A ROS logger with one method for each severity: rclpy allows one severity a source line."""

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def info(self, line: str) -> None:
        """Log an event."""
        self._logger.info(printable(line))

    def warning(self, line: str) -> None:
        """Log something that the user may want to fix."""
        self._logger.warning(printable(line))

    def error(self, line: str) -> None:
        """Log a failure."""
        self._logger.error(printable(line))
