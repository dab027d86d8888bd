# SPDX-License-Identifier: Apache-2.0
"""System tests of two vehicles in one run and one ROS: separate topics, frames and commands."""

from math import hypot
from pathlib import Path

import pytest

from .rig import REPOSITORY, Observer, rig, wait_for

pytestmark = pytest.mark.system

TREE = {"base_link": "odom", "imu_link": "base_link", "scan_link": "base_link"}
"""Parent of each frame of a rover, without its prefix."""
SCENARIO = REPOSITORY / "scenarios" / "two_rovers.yaml"


def test_each_drives_by_its_own_commands_and_has_its_own_frames(tmp_path: Path) -> None:
    with rig(tmp_path) as it:
        own = it.scenario.read_text(encoding="utf-8").partition("\ngateway:")
        it.scenario.write_text(SCENARIO.read_text(encoding="utf-8") + "".join(own[1:]))
        observer = Observer(it, "tests.system.ros_two_rovers")
        it.up()

        def has_driven(topic: str) -> bool:
            ways = [message["at"] for message in observer.read().get(topic, [])]
            return bool(ways) and max(hypot(x, y) for x, y in ways) > 0.7

        for topic in ("/first/odom", "/second/odom"):
            wait_for(lambda topic=topic: has_driven(topic), 60, f"{topic} tells of a way")
        for name in ("first", "second"):
            frames = [f"{name}/odom", f"{name}/base_link"]
            assert all(m["frames"] == frames for m in observer.messages[f"/{name}/odom"])
        # Straight on as commanded; the other is on its circle.
        x, y = observer.messages["/second/odom"][-1]["at"]
        assert abs(y) < 0.1 * x
        parents: dict[str, str] = {}
        for topic in ("/tf", "/tf_static"):
            for message in observer.messages[topic]:
                parents |= message["frames"]
        assert parents == {
            f"{name}/{child}": f"{name}/{parent}"
            for name in ("first", "second")
            for child, parent in TREE.items()
        }
        for name in ("first", "second"):
            for topic in ("imu", "scan"):
                frames = {message["frame"] for message in observer.messages[f"/{name}/{topic}"]}
                assert frames == {f"{name}/{topic}_link"}
