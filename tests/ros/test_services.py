# SPDX-License-Identifier: Apache-2.0
"""The node's services with real ROS 2, and a gateway that stands in for a simulator."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from udp_bridge import Link, Message
from udp_bridge.wire import control
from udp_bridge.wire.control import RunCommand, RunCommandReply, Subscribe
from udp_bridge.wire.run_commands import PAUSED, STEP
from udp_bridge.wire.types import CONTROL, SUBSCRIBE, type_number

from .bodies import imu
from .calling import Caller
from .conftest import RELIABLE, Ros

Address = tuple[str, int]


class Simulator:
    """A gateway that subscribes, and replies to commands unless it is silent."""

    def __init__(self, node: Address, *, is_silent: bool = False) -> None:
        self.node = node
        self.commands: list[RunCommand] = []
        self._is_silent = is_silent
        self._is_over = threading.Event()
        self.link = Link(("127.0.0.1", 0), on_message=self._on_message)
        self._thread = threading.Thread(target=self._keep_subscribing)
        self._thread.start()

    def _keep_subscribing(self) -> None:
        subscribe = Subscribe(type_number("Twist"), lease_s=3).pack()
        while not self._is_over.wait(0.1):
            self.link.send(SUBSCRIBE, "/cmd_vel", "", time.time_ns(), subscribe, self.node)

    def _on_message(self, message: Message, sender: Address) -> None:
        if message.msg_type == CONTROL and isinstance(
            command := control.parse(message.body), RunCommand
        ):
            self.commands.append(command)
            if not self._is_silent:
                ticks = sum({command.number: command.ticks for command in self.commands}.values())
                answer = RunCommandReply(command.number, PAUSED, ticks)
                self.link.send(CONTROL, "", "", time.time_ns(), answer.pack(), sender)

    def close(self) -> None:
        self._is_over.set()
        self._thread.join()
        self.link.close()


@contextmanager
def simulator(node: Address, *, is_silent: bool = False) -> Iterator[Simulator]:
    it = Simulator(node, is_silent=is_silent)
    try:
        yield it
    finally:
        it.close()


@contextmanager
def calling(ros: Ros, node: str = "/udp_bridge") -> Iterator[Caller]:
    caller = Caller(ros.environment, node)
    try:
        yield caller
    finally:
        caller.close()


def test_names_stand_under_the_nodes_and_steps_are_as_many_as_the_parameter_says(ros: Ros) -> None:
    arguments = ("--ros-args", "-r", "__ns:=/rig", "-r", "__node:=bridge", "-p", "step_ticks:=40")
    _, address = ros.bridge(*arguments, "-r", "~/pause:=/stand_still")
    with simulator(address) as it, calling(ros, "/rig/bridge") as caller:
        assert caller.trigger("step") == (True, "paused at tick 40")
        assert caller.trigger("state") == (True, "paused at tick 40")
        assert {command.ticks for command in it.commands if command.action == STEP} == {40}
        with calling(ros, "") as other:
            assert other.trigger("stand_still") == (True, "paused at tick 40")


def test_without_a_gateway_it_says_so(ros: Ros) -> None:
    ros.bridge()
    with calling(ros) as caller:
        is_done, said = caller.trigger("pause")
    assert not is_done
    assert said.startswith("no gateway found")


def test_peer_parameter_selects_one_of_two_gateways(ros: Ros) -> None:
    _, address = ros.bridge()
    with simulator(address) as one, simulator(address) as other:
        with calling(ros) as caller:
            is_done, said = caller.trigger("pause")
            assert not is_done
            for it in (one, other):
                assert f"127.0.0.1:{it.link.address[1]}" in said
        assert one.commands == other.commands == []

        peer = f"peer:=127.0.0.1:{one.link.address[1]}"
        _, one.node = ros.bridge("--ros-args", "-p", peer, "-r", "__node:=sure")
        other.node = one.node
        with calling(ros, "/sure") as caller:
            assert caller.trigger("pause") == (True, "paused at tick 0")
        assert one.commands
        assert not other.commands


def test_while_one_waits_data_flow_and_the_node_ends_at_once(ros: Ros) -> None:
    node, address = ros.bridge()
    listener = ros.listen(("sensor_msgs/msg/Imu", "/imu", RELIABLE))
    with simulator(address, is_silent=True) as it, calling(ros) as caller:

        def wait() -> None:
            with suppress(ValueError):  # the caller is killed, so it prints no answer
                caller.trigger("pause")

        waiting = threading.Thread(target=wait, daemon=True)
        waiting.start()
        stamp = 0
        while len(it.commands) < 30:  # three seconds
            stamp += 10_000_000
            it.link.send(type_number("Imu"), "/imu", "imu", stamp, imu(stamp), address)
            time.sleep(0.01)
        listener.wait_for_stamp("/imu", stamp)
        assert waiting.is_alive()
        assert node.end() == 0
        assert len(it.commands) < 70, "it did not wait for the 80th"
        caller.process.kill()
        waiting.join(20)


def test_a_ros_without_either_package(ros: Ros, tmp_path: Path) -> None:
    hidden = "import sys\nsys.modules['std_srvs'] = None\n"
    (tmp_path / "sitecustomize.py").write_text(hidden, encoding="utf-8")
    ros.environment["PYTHONPATH"] += f":{tmp_path}"
    node, _ = ros.bridge()
    node.wait_for("neither simulation_interfaces nor std_srvs is installed: no services")
