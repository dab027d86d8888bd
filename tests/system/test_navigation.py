# SPDX-License-Identifier: Apache-2.0
"""System test of the navigation example: to a goal, around an obstacle that appears on the way."""

from functools import partial
from pathlib import Path
from typing import TypeVar

import msgspec
import numpy as np
import pytest

from groundlink.__main__ import main
from groundlink.bus.control_client import ask_world
from groundlink.bus.core_topics import STATE
from groundlink.bus.inbox import BusInbox
from groundlink.bus.session import Bus
from groundlink.bus.topics import FROM_ROS, VITALS
from groundlink.episode.world_queries import SpawnQuery
from groundlink.messages.base import BusMessage, State
from groundlink.messages.ground_truth import Vitals
from groundlink.messages.navigation import PoseStamped

from .rig import REPOSITORY, rig, wait_for

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytest.importorskip("skimage", reason="no scikit-image here")
pytestmark = pytest.mark.system

FOLDER = REPOSITORY / "examples/navigation"
GOAL_M = (0.4, -0.6)
BARREL_M = (-2.2, -0.3)
"""On the straight line to the goal."""

BARREL_RADIUS_M = 0.29

M = TypeVar("M", bound=BusMessage)


def messages(inbox: BusInbox[M]) -> list[M]:
    """Return all that an inbox holds."""
    return [message for _, message in iter(partial(inbox.get, seconds=0), None)]


def test_the_example_drives_to_a_goal_around_an_obstacle(tmp_path: Path) -> None:
    """Sim time waits for the node. It begins with a pose that is 0.25 m and 6 degrees off."""
    map_file = tmp_path / "map.yaml"
    shipped = FOLDER / "lab_navigation.yaml"
    assert not main(
        ["world", "map", str(shipped), "--heights-m", "0.05", "0.9", "--out", str(map_file)]
    )
    states: BusInbox[State] = BusInbox(depth=1 << 16)
    vitals: BusInbox[Vitals] = BusInbox(depth=10_000)
    poses: BusInbox[PoseStamped] = BusInbox(depth=10_000)
    with rig(tmp_path) as it:
        addresses = f"gateway: {{bind: {it.address(it.bind)}, peer: {it.address(it.peer)}}}\n"
        it.scenario.write_text(shipped.read_text("utf-8") + addresses, encoding="utf-8")
        parameters = (f"map:={map_file}", "initial_pose:=[-4.4, 0.15, 0.1]")
        options = [word for parameter in parameters for word in ("-p", parameter)]
        node = str(FOLDER / "navigation_node.py")
        it.start(node, "--ros-args", *options, log="navigation.log")
        it.start(str(FOLDER / "send_goal.py"), *map(str, GOAL_M), log="goal.log")
        it.up()
        wait_for(it.is_answered, 60, "a router")
        with Bus(connect=it.endpoint) as bus:
            bus.subscribe(STATE.key_in(it.run), State, states)
            bus.subscribe(VITALS.key_in(it.run, vehicle="rover"), Vitals, vitals)
            bus.subscribe(FROM_ROS["pose"].key_in(it.run, vehicle="rover"), PoseStamped, poses)
            wait_for(lambda: len(poses), 60, f"a pose: {it.log('up.log')}")
            place = (*BARREL_M, 0.0)
            spawn = msgspec.json.encode(SpawnQuery(uri="barrel", position_m=place))
            answer = msgspec.json.decode(ask_world(bus, it.run, spawn))
            assert "error" not in answer, answer
            wait_for(
                lambda: "arrived at" in it.log("navigation.log"), 100, it.log("navigation.log")
            )
    seen = messages(states)
    path_m = np.array([state.vehicles["rover"].poses()[0, :2] for state in seen])
    ticks = np.array([state.tick for state in seen])
    assert np.hypot(*(path_m[-1] - GOAL_M)) < 0.2
    touched = [contact.name for message in messages(vitals) for contact in message.contacts]
    assert touched == []
    # It had to leave the straight line, and saw the barrel in time to do so without a detour.
    assert np.hypot(*(path_m[ticks > answer["tick"]] - BARREL_M).T).min() > BARREL_RADIUS_M + 0.35
    assert np.hypot(*np.diff(path_m, axis=0).T).sum() < 7.0
    stamps = np.array([state.stamp_nanos for state in seen])
    located = [pose for pose in messages(poses) if stamps[0] <= pose.stamp_nanos <= stamps[-1]]
    errors_m = [
        np.hypot(*(path_m[np.searchsorted(stamps, pose.stamp_nanos)] - pose.position_m[:2]))
        for pose in located
    ]
    assert len(errors_m) > 30
    assert max(errors_m) < 0.1
