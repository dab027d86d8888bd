# SPDX-License-Identifier: Apache-2.0
"""ROS 2 services that control the run: simulation_interfaces, or std_srvs/Trigger.

A service call may take seconds. The services therefore have their own threads, and a second node,
because rclpy serves the callbacks of one node in one executor. Their names follow those of the
bridge's node, and are remapped with it. The standard's are at `/`, as `/spawn_entity`, unless the
parameter `services_namespace` says otherwise; `~/pause` is `/udp_bridge/pause`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any, NamedTuple

from rclpy.action.server import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidServiceNameException
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node

from udp_bridge.node.command_client import RunCommandClient
from udp_bridge.node.run_control import RunControl, triggers

THREADS = 8
"""Number of concurrent calls. Only one of them steps; all others end within seconds."""


WAKE_S = 0.5
"""Longest wait for a call: an executor that is shut down as it begins to wait is not woken."""


class _Offer(NamedTuple):
    """Available services and actions, each as name, type and callback."""

    package: str
    namespace: str
    services: list[tuple[str, Any, Callable[[Any, Any], Any]]]
    actions: list[tuple[str, Any, Callable[[Any], Any]]]


class Ros2Services:
    """Services, active until `close`.

    Parameters
    ----------
    node
        The bridge's node, which provides the names of the services.
    namespace
        Namespace of the standard's services; `~` is the node's name.
    """

    def __init__(self, node: Node, client: RunCommandClient, namespace: str) -> None:
        self._client = client
        self._node = Node(
            f"{node.get_name()}_services",
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,  # they may rename the bridge's node
            start_parameter_services=False,
            enable_rosout=False,
        )
        together = ReentrantCallbackGroup()
        offer = _offered(node, client, namespace)
        for name, kind, callback in offer.services:
            full_name = full_service_name(node, offer.namespace, name)
            self._node.create_service(kind, full_name, callback, callback_group=together)
        self._actions = [
            ActionServer(
                self._node,
                kind,
                full_service_name(node, offer.namespace, name),
                execute_callback=callback,
                callback_group=together,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )
            for name, kind, callback in offer.actions
        ]
        if offer.services:
            names = ", ".join(name for name, *_ in (*offer.services, *offer.actions))
            place = full_service_name(node, offer.namespace, "")
            node.get_logger().info(f"services of {offer.package} at {place}: {names}")
        else:
            node.get_logger().warning(
                "neither simulation_interfaces nor std_srvs is installed: no services"
            )
        self._executor = MultiThreadedExecutor(THREADS, context=node.context)
        self._executor.add_node(self._node)
        self._is_closed = False
        self._thread = threading.Thread(target=self._serve, name="services", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop all threads; waiting calls fail."""
        self._client.close()
        self._is_closed = True
        self._executor.wake()
        self._thread.join()
        self._executor.shutdown()
        for action in self._actions:
            action.destroy()
        self._node.destroy_node()

    def _serve(self) -> None:
        while not self._is_closed:
            self._executor.spin_once(timeout_sec=WAKE_S)


def full_service_name(node: Node, namespace: str, name: str) -> str:
    """Return the full name of a service, or of a namespace for an empty name.

    Raises
    ------
    ValueError
        When it is no name of ROS.
    """
    try:
        found = node.resolve_service_name(f"{namespace.rstrip('/')}/{name or 'service'}")
    except (InvalidServiceNameException, RuntimeError) as error:
        raise ValueError(f"services_namespace {namespace!r}: {error}") from None
    return str(found if name else found.removesuffix("service"))


def _offered(node: Node, client: RunCommandClient, namespace: str) -> _Offer:
    """Return the services whose types are installed."""
    if find_spec("simulation_interfaces"):
        from .standard_services.table import StandardServices

        standard = StandardServices(client)
        return _Offer("simulation_interfaces", namespace, standard.services(), standard.actions())
    if find_spec("std_srvs"):
        from std_srvs.srv import Trigger

        node.declare_parameter("step_ticks", 1)
        filled = triggers(
            RunControl(client), lambda: int(node.get_parameter("step_ticks").value or 0)
        )
        plain: list[tuple[str, Any, Callable[[Any, Any], Any]]] = [
            (name, Trigger, partial(_fill, fill)) for name, fill in filled.items()
        ]
        return _Offer("std_srvs", "~", plain, [])
    return _Offer("", "~", [], [])


def _fill(fill: Callable[[Any], Any], _: Any, response: Any) -> Any:
    return fill(response)
