# SPDX-License-Identifier: Apache-2.0
"""Services of ROS 1 that control the run's time: std_srvs/Trigger such as `~pause`.

rospy serves each caller in a thread of its own, so a waiting call blocks no other.
"""

from __future__ import annotations

import logging

import rospy

from udp_bridge.node.command_client import RunCommandClient
from udp_bridge.node.run_control import RunControl, triggers


class Ros1Services:
    """Serves calls until `close`; logs a warning when std_srvs is not installed."""

    def __init__(self, client: RunCommandClient, log: logging.Logger) -> None:
        self._client = client
        self._services = []
        try:
            from std_srvs.srv import Trigger, TriggerResponse
        except ImportError:
            log.warning("std_srvs is not installed: no services")
            return
        filled = triggers(RunControl(client), lambda: int(rospy.get_param("~step_ticks", 1)))
        for name, fill in filled.items():
            serve = lambda _, fill=fill: fill(TriggerResponse())  # noqa: E731
            self._services.append(rospy.Service(f"~{name}", Trigger, serve))
        log.info(f"services of std_srvs at {rospy.get_name()}/: {', '.join(filled)}")

    def close(self) -> None:
        """End the services; waiting calls fail."""
        self._client.close()
        for service in self._services:
            service.shutdown()
