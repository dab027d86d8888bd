# SPDX-License-Identifier: Apache-2.0
"""A ROS node that calls services as it is told, line by line, and says what time it is in ROS.

A line in is {"service": NAME, "kind": TYPE, "request": {...}}, or "action" and "goal" instead, with
"cancel" true where it shall be cancelled at its first feedback, or {}. The line out holds the
response's fields, where there is one, and under "clock" the newest /clock in nanoseconds.
"""

import json
import os
import sys
from functools import cache
from importlib import import_module
from typing import Any

from udp_bridge_ros2.environment import apply_defaults

apply_defaults(os.environ)

import rclpy  # noqa: E402
from rclpy.action.client import ActionClient  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402

SECONDS = 30.0
"""How long a call may take."""


def fields(message: Any) -> Any:
    """Return a message as JSON has it."""
    if isinstance(message, list) or hasattr(message, "tolist"):  # or an array of numbers
        return [fields(part) for part in message]
    if not hasattr(message, "get_fields_and_field_types"):
        return message
    return {name: fields(getattr(message, name)) for name in message.get_fields_and_field_types()}


@cache
def client_of(node: Node, service: str, kind: str) -> Any:
    """Return a client that stays: discovery takes longer than a call."""
    package, group, name = kind.split("/")
    return node.create_client(getattr(import_module(f"{package}.{group}"), name), service)


def call(node: Node, service: str, kind: str, request: dict[str, Any]) -> Any:
    client = client_of(node, service, kind)
    if not client.wait_for_service(SECONDS):
        return {"error": f"{service} is not there"}
    asked = client.srv_type.Request()
    for place, value in request.items():
        *path, last = place.split(".")
        target = asked
        for step in path:
            target = getattr(target, step)
        setattr(target, last, value)
    future = client.call_async(asked)
    rclpy.spin_until_future_complete(node, future, timeout_sec=SECONDS)
    response = fields(future.result()) if future.done() else {"error": f"{service} is silent"}
    return response


def act(node: Node, action: str, kind: str, goal: dict[str, Any], cancel: bool) -> Any:
    package, group, name = kind.split("/")
    action_type = getattr(import_module(f"{package}.{group}"), name)
    client = ActionClient(node, action_type, action)
    if not client.wait_for_server(SECONDS):
        return {"error": f"{action} is not there"}
    told: list[Any] = []
    sent = client.send_goal_async(
        action_type.Goal(**goal), feedback_callback=lambda message: told.append(message.feedback)
    )
    rclpy.spin_until_future_complete(node, sent, timeout_sec=SECONDS)
    handle = sent.result()
    while cancel and not told:
        rclpy.spin_once(node, timeout_sec=0.1)
    if cancel:
        rclpy.spin_until_future_complete(node, handle.cancel_goal_async(), timeout_sec=SECONDS)
    result = handle.get_result_async()
    rclpy.spin_until_future_complete(node, result, timeout_sec=SECONDS)
    client.destroy()
    return {
        "status": result.result().status,
        "feedback": [fields(feedback) for feedback in told],
        **fields(result.result().result),
    }


def main() -> None:
    rclpy.init()
    node = Node("caller")
    newest = [-1]
    node.create_subscription(
        Clock,
        "/clock",
        lambda message: newest.__setitem__(0, message.clock.sec * 10**9 + message.clock.nanosec),
        100,
    )
    print("ready", flush=True)
    for line in sys.stdin:
        wanted = json.loads(line)
        do = act if "action" in wanted else call
        response = do(node, **wanted) if wanted else {}
        for _ in range(20):  # what has arrived
            rclpy.spin_once(node, timeout_sec=0.005)
        print(json.dumps({**response, "clock": newest[0]}), flush=True)


if __name__ == "__main__":
    main()
