# SPDX-License-Identifier: Apache-2.0
"""ROS 1 services that pause, step and reset the run: std_srvs/Trigger such as `~pause`.

rospy serves each caller in its own thread, so a waiting call does not block other calls.
"""

from __future__ import annotations

import logging

import rospy

from udp_bridge.node.command_client import RunCommandClient
from udp_bridge.node.run_control import RunControl, triggers


class Ros1Services:
    """Services, active until `close`. Logs a warning if std_srvs is not installed."""

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
        """Stop the services; waiting calls fail."""
        self._client.close()
        for service in self._services:
            service.shutdown()
