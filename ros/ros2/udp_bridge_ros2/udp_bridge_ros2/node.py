# SPDX-License-Identifier: Apache-2.0
"""ROS 2 node: parameters, and a `BridgeNode` with ROS 2's publishers and subscriptions.

The thread that calls `turn` owns the subscriptions.
"""

from __future__ import annotations

import os
import time

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from udp_bridge.node.bridge_node import BridgeNode, Settings
from udp_bridge.node.diagnostics import TOPIC, DiagnosticsPublisher

from . import environment
from .services import Ros2Services, full_service_name
from .topics import Ros2Graph, Ros2Publishers, Ros2Subscriptions

MAY_BE_OTHERS = ("datagram", "allow_any_peer")
"""Parameters that accept text, a number or a boolean."""


class Ros2Node(Node):
    """ROS 2 end of UDP Bridge.

    Its parameters are those of `Settings`, `frame_prefix`, a prefix of all published frames, and
    `services_namespace`, the namespace of the services of simulation_interfaces. `use_sim_time`
    and `qos_overrides` work as in every node.

    Parameters
    ----------
    given
        Settings that override the parameters of the same names, unless they are None.

    Raises
    ------
    ValueError
        When an address or a namespace is invalid, or the key can't be used.
    OSError
        When an address can't be resolved or bound.
    """

    def __init__(self, **given: str | None) -> None:
        overrides = [
            Parameter(name, value=text) for name, text in given.items() if text is not None
        ]
        super().__init__("udp_bridge", parameter_overrides=overrides)
        settings = {
            name: str(
                self.declare_parameter(
                    name, default, ParameterDescriptor(dynamic_typing=name in MAY_BE_OTHERS)
                ).value
            )
            for name, default in Settings()._asdict().items()
        }
        frame_prefix = str(self.declare_parameter("frame_prefix", "").value)
        namespace = str(self.declare_parameter("services_namespace", "/").value)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        try:
            full_service_name(self, namespace, "")  # raises before threads start
            self._bridge = BridgeNode(
                *(
                    Settings(**settings),
                    Ros2Publishers(self, frame_prefix),
                    Ros2Subscriptions(self),
                ),
                Ros2Graph(self),
                wake=self.create_guard_condition(lambda: None).trigger,
            )
        except (OSError, ValueError):
            self._leave()
            raise
        self._diagnostics = DiagnosticsPublisher(
            self._bridge.link,
            advertise=lambda message_class: self.create_publisher(message_class, TOPIC, 1),
            stamp=lambda: self.get_clock().now().to_msg(),
            level=lambda level: bytes([level]),
            warn=self.get_logger().warning,
        )
        self._bridge.log_start(f"; {environment.describe(os.environ)}")
        self._run_services = Ros2Services(self, self._bridge.command_client, namespace)

    def turn(self) -> None:
        """Process ROS callbacks and the requests of peers, for 0.1 s at most."""
        now_nanos = time.monotonic_ns()
        wait_s = self._bridge.turn(now_nanos)
        self._diagnostics.turn(now_nanos)
        self._executor.spin_once(timeout_sec=wait_s)

    def close(self) -> None:
        """Stop all threads and log the totals."""
        self._run_services.close()
        self._bridge.close()
        self._leave()

    def _leave(self) -> None:
        self._executor.shutdown()
        self.destroy_node()
