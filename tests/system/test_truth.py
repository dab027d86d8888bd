# SPDX-License-Identifier: Apache-2.0
"""System tests of ground truth in ROS: clouds without errors, wheels and all bodies."""

from pathlib import Path

import pytest

from groundlink.loader import load
from groundlink.scene.bodies import body_names
from groundlink.scene.build import solids

from .rig import Observer, rig, wait_for

pytestmark = pytest.mark.system

CHANGES = (
    ("block_deg: 0,", "truth: true, block_deg: 90,"),
    ("    sensors:\n", "    ground_truth: {push: true}\n    sensors:\n"),
)


def test_the_truth_of_a_run_reaches_ros(tmp_path: Path) -> None:
    with rig(tmp_path, time_section="time: {mode: fast}\nbodies: {push: true}\n") as it:
        text = it.scenario.read_text(encoding="utf-8")
        for old, new in CHANGES:
            assert old in text
            text = text.replace(old, new)
        it.scenario.write_text(text, encoding="utf-8")
        observer = Observer(it)
        it.up()
        for topic in ("/points/truth", "/ground_truth/wheels", "/ground_truth/bodies"):
            wait_for(lambda t=topic: observer.count(t) > 8, 60, f"{topic} in ROS")
        seen = observer.read()

        clouds = {cloud["stamp"]: cloud for cloud in seen["/points"]}
        both = [truth for truth in seen["/points/truth"] if truth["stamp"] in clouds]
        assert both
        for truth in both:
            cloud = clouds[truth["stamp"]]
            assert (truth["frame"], truth["width"]) == (cloud["frame"], cloud["width"])
            assert truth["fields"] == [*cloud["fields"], "body"]
            assert truth["point_step"] == 26
            assert truth["data"] == 26 * truth["width"] > 0

        scenario = load(it.scenario)
        wheels = [wheel.name for wheel in scenario.vehicles[0].model.wheels]
        for joints in seen["/ground_truth/wheels"]:
            assert joints["name"] == wheels
            assert {len(joints[what]) for what in ("position", "velocity", "effort")} == {4}
        for bodies in seen["/ground_truth/bodies"]:
            assert list(bodies["frames"]) == [*body_names(scenario, solids(scenario))]
            assert set(bodies["frames"].values()) == {"world"}
