# SPDX-License-Identifier: Apache-2.0
"""ROS 2 client of the simulator under test: calls, and one readable line for a wrong answer."""

import re
import time
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NoReturn

import pytest
import rclpy
from rclpy.action.client import ActionClient
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from simulation_interfaces.action import SimulateSteps
from simulation_interfaces.msg import Result
from simulation_interfaces.msg import SpawnEntity as SpawnRequest
from simulation_interfaces.srv import GetSimulatorFeatures, SpawnEntities, SpawnEntity

from .features import CODES, constants

SETTLED_S = 0.2
"""How long a list of services, or a paused clock, stays the same until it counts as complete."""

LONGEST_REQUEST = 300
"""Number of characters of a request in a finding."""

MOST_FEEDBACK = 1000
"""Depth of the queue for feedback of SimulateSteps."""


class SimulatorClient:
    """Services and the action of a simulator, under one namespace.

    Parameters
    ----------
    namespace
        Namespace of the services, such as ``/`` or ``/gazebo``.
    call_timeout_s
        How long a service may take to respond.
    find_timeout_s
        How long to wait until the simulator's services appear.
    """

    def __init__(self, namespace: str, call_timeout_s: float, find_timeout_s: float) -> None:
        self._namespace = "/" + namespace.strip("/")
        self._timeout_s = call_timeout_s
        self._find_s = find_timeout_s
        self._context = Context()
        rclpy.init(context=self._context)
        self._node = Node(
            "simulation_interfaces_tck",
            context=self._context,
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._clients: dict[Any, Any] = {}
        self._clock_nanos = -1
        self._feedback: dict[bytes, list[tuple[int, int]]] = {}
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._node.create_subscription(Clock, "/clock", self._on_clock, newest)

    def close(self) -> None:
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)

    def find(self) -> None:
        """Wait until all services have appeared; end the session if the simulator is not there."""
        name = self.name_of(GetSimulatorFeatures)
        if not self._client(GetSimulatorFeatures).wait_for_service(self._find_s):
            pytest.exit(
                f"no simulator: {name} did not appear within {self._find_s:g} s. "
                "Fix: start the simulator, or name its namespace with --namespace",
                returncode=2,
            )
        self._client(SimulateSteps)  # appears together with the services
        # rclpy's client drops the feedback that arrives after the result.
        feedback = SimulateSteps.Impl.FeedbackMessage
        topic = f"{self.name_of(SimulateSteps)}/_action/feedback"
        self._node.create_subscription(feedback, topic, self._on_feedback, MOST_FEEDBACK)
        self.settle(lambda: len(self._node.get_service_names_and_types()))

    def name_of(self, interface: Any) -> str:
        """Return the full name of a service or an action: its type's name in snake case."""
        name = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", interface.__name__).lower()
        return f"{self._namespace.rstrip('/')}/{name}"

    def serves(self, interface: Any) -> bool:
        """Return whether a service or an action is there, with the standard's type."""
        if interface is SimulateSteps:
            return bool(self._client(interface).server_is_ready())
        kind = f"simulation_interfaces/srv/{interface.__name__}"
        return kind in dict(self._node.get_service_names_and_types()).get(
            self.name_of(interface), ()
        )

    # -- features ---------------------------------------------------------------------------------

    @cached_property
    def announced(self) -> frozenset[str]:
        """Names of the features that the simulator announces."""
        codes = {*self.features.features}
        return frozenset(name for name, code in CODES.items() if code in codes)

    @cached_property
    def features(self) -> Any:
        """SimulatorFeatures of the simulator."""
        return self.call(GetSimulatorFeatures).features

    def need(self, *features: str) -> None:
        """Report the clause as not tested, unless all features are announced."""
        missing = [feature for feature in features if feature not in self.announced]
        if missing:
            not_tested(f"needs {', '.join(missing)}")

    # -- calls ------------------------------------------------------------------------------------

    def call(self, service: Any, **fields: Any) -> Any:
        """Call a service with the given fields of its request; return the response."""
        name = self.name_of(service)
        if not self.serves(service):
            fail(f"{name} is not served (simulation_interfaces/srv/{service.__name__})")
        return self.wait_for(
            self._client(service).call_async(service.Request(**fields)), f"{name} responds"
        )

    def expect(self, codes: int | Sequence[int], service: Any, **fields: Any) -> Any:
        """Call a service whose result must be one of the codes; return the response."""
        response = self.call(service, **fields)
        self.check(codes, response.result, self.name_of(service), service.Response, fields)
        return response

    def check(
        self,
        codes: int | Sequence[int],
        result: Any,
        name: str,
        named_in: Any = Result,
        request: Any = "",
    ) -> None:
        """Fail unless a result is one of the codes, whose names are those in a message class."""
        wanted = [codes] if isinstance(codes, int) else [*codes]
        if result.result in wanted:
            return
        names = {value: key for key, value in (constants(named_in) | constants(Result)).items()}
        expected = " or ".join(names.get(code, str(code)) for code in wanted)
        got = names.get(result.result, f"the unknown code {result.result}")
        message = f" ({result.error_message!r})" if result.error_message else ""
        fail(f"{name}: expected {expected}, got {got}{message}; request: {_short(request)}")

    def spawn(self, feature: str, **fields: Any) -> Any:
        """Spawn by the interface of SPAWNING or SPAWNING_ENTITIES; return result and entity_name.

        The summary of SpawnEntities must say the same as its only result.
        """
        if feature == "SPAWNING":
            return self.call(SpawnEntity, **fields)
        response = self.call(SpawnEntities, spawn_requests=[SpawnRequest(**fields)])
        name = self.name_of(SpawnEntities)
        if len(response.results) != 1:
            fail(f"{name}: expected one entry in `results`, got {len(response.results)}")
        (spawned,) = response.results
        is_ok = spawned.result.result == Result.RESULT_OK
        summary = Result.RESULT_OK if is_ok else SpawnEntities.Response.ENTITIES_SPAWN_FAILED
        self.check(summary, response.result, name, SpawnEntities.Response, fields)
        return spawned

    def wait_for(self, future: Any, what: str, timeout_s: float | None = None) -> Any:
        """Return what a future holds, once it is done; fail if that takes too long."""
        limit_s = self._timeout_s if timeout_s is None else timeout_s
        self._executor.spin_until_future_complete(future, limit_s)
        if not future.done():
            fail(f"{what}: not within {limit_s:g} s")
        return future.result()

    def spin(self, seconds: float) -> None:
        """Receive for some time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def settle(self, value: Callable[[], int]) -> None:
        """Receive until a value stays the same, at most for five seconds."""
        end = time.monotonic() + 5.0
        seen, since = value(), time.monotonic()
        while time.monotonic() < min(since + SETTLED_S, end):
            self._executor.spin_once(0.02)
            if (now := value()) != seen:
                seen, since = now, time.monotonic()

    def action(self) -> Any:
        """Return the client of SimulateSteps."""
        if not self.serves(SimulateSteps):
            name = self.name_of(SimulateSteps)
            fail(f"{name} is not served (simulation_interfaces/action/SimulateSteps)")
        return self._client(SimulateSteps)

    def feedback_of(self, goal: Any) -> list[tuple[int, int]]:
        """Return completed and remaining steps of each feedback of an accepted goal."""
        return self._feedback.setdefault(bytes(goal.goal_id.uuid), [])

    def _on_feedback(self, message: Any) -> None:
        told = message.feedback
        feedback = self._feedback.setdefault(bytes(message.goal_id.uuid), [])
        feedback.append((told.completed_steps, told.remaining_steps))

    # -- time -------------------------------------------------------------------------------------

    def clock_nanos(self) -> int:
        """Return the time of /clock once it stands still; without /clock nothing is tested."""
        self.settle(lambda: self._clock_nanos)
        if self._clock_nanos < 0:
            not_tested("nothing is published on /clock")
        return self._clock_nanos

    def clock_goes_on(self) -> bool:
        """Return whether the time of /clock increases within a second."""
        before = self._clock_nanos
        end = time.monotonic() + 1.0
        while self._clock_nanos <= before and time.monotonic() < end:
            self._executor.spin_once(0.05)
        return self._clock_nanos > before

    def _on_clock(self, message: Any) -> None:
        self._clock_nanos = message.clock.sec * 10**9 + message.clock.nanosec

    def _client(self, interface: Any) -> Any:
        if interface not in self._clients:
            name = self.name_of(interface)
            self._clients[interface] = (
                ActionClient(self._node, interface, name)
                if interface is SimulateSteps
                else self._node.create_client(interface, name)
            )
        return self._clients[interface]


def fail(message: str) -> NoReturn:
    """Fail the clause with one line; messages in it lose the names of their packages."""
    pytest.fail(re.sub(r"\b\w+\.(msg|srv|action)\.", "", message), pytrace=False)


def not_tested(reason: str) -> NoReturn:
    """Report the clause as not tested."""
    pytest.skip(f"not tested: {reason}")


def _short(request: Any) -> str:
    """Return the given fields of a request in one line that is not too long."""
    if not request:
        return "empty"
    text = ", ".join(f"{key}={value!r}" for key, value in request.items())
    return text if len(text) <= LONGEST_REQUEST else text[:LONGEST_REQUEST] + "..."
