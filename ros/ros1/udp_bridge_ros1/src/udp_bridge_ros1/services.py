# SPDX-License-Identifier: Apache-2.0
"""Services on the run's time, as Triggers of std_srvs under the node's name: `~pause` and others.

Rule: rospy serves each caller in a thread of its own, so a call that waits holds up nobody.
"""

from __future__ import annotations

import logging

import rospy

from udp_bridge.node.command_client import RunCommandClient
from udp_bridge.node.run_control import RunControl
from udp_bridge.node.triggers import triggers


class Ros1Services:
    """Serves until it is closed; where std_srvs is not installed, a line says so."""

    def __init__(self, asking: RunCommandClient, log: logging.Logger) -> None:
        self._asking = asking
        self._services = []
        try:
            from std_srvs.srv import Trigger, TriggerResponse
        except ImportError:
            log.warning("std_srvs is not installed: no services")
            return
        filled = triggers(RunControl(asking), lambda: int(rospy.get_param("~step_ticks", 1)))
        for name, fill in filled.items():
            serve = lambda _, fill=fill: fill(TriggerResponse())  # noqa: E731
            self._services.append(rospy.Service(f"~{name}", Trigger, serve))
        log.info(f"services of std_srvs at {rospy.get_name()}/: {', '.join(filled)}")

    def close(self) -> None:
        """Serve no more; calls that wait are answered that it is over."""
        self._asking.close()
        for service in self._services:
            service.shutdown()
