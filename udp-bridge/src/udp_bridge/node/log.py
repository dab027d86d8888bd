# SPDX-License-Identifier: Apache-2.0
"""The log of a node: each line escaped, as it may hold names that came over the network."""

from __future__ import annotations

from typing import Any

from udp_bridge.wire.printable import printable


class Log:
    """A logger of ROS, with one method for each severity that is used.

    Each stands in a line of its own: rclpy allows one severity for a line of code.
    """

    def __init__(self, logger: Any) -> None:
        self._logger = logger

    def info(self, line: str) -> None:
        """Log an event."""
        self._logger.info(printable(line))

    def warning(self, line: str) -> None:
        """Log what the user may want to mend."""
        self._logger.warning(printable(line))

    def error(self, line: str) -> None:
        """Log what failed."""
        self._logger.error(printable(line))
