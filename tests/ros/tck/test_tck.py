# SPDX-License-Identifier: Apache-2.0
"""The conformance kit: a whole simulator passes, each seeded violation is caught."""

import ast
import json
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest

from tests.building import pip
from tests.ros.interfaces import simulation_interfaces
from tests.ros_domains import next_domain

pytest.importorskip("rclpy", reason="no ROS 2 here")
pytestmark = pytest.mark.timeout(400)  # the first one compiles the messages

ROOT = Path(__file__).resolve().parents[3]
SOURCES = ROOT / "ros" / "simulation_interfaces_tck" / "src"
FEATURES = 32
ALLOWED = {"pytest", "rclpy", "simulation_interfaces", "simulation_interfaces_tck"}
MESSAGES = {"action_msgs", "builtin_interfaces", "geometry_msgs", "rosgraph_msgs", "std_msgs"}


@pytest.fixture(scope="module")
def results(pytestconfig: pytest.Config) -> dict[str, Any]:
    """What the kit finds of each reference simulator, run in one process."""
    interfaces = simulation_interfaces(pytestconfig.cache.mkdir("simulation_interfaces"))
    kept = {key: value for key, value in os.environ.items() if not key.startswith(("ROS_", "RMW_"))}
    environment = kept | {
        "ROS_DOMAIN_ID": next_domain(),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "PYTHONPATH": os.pathsep.join(map(str, (interfaces, SOURCES))),
    }
    done = subprocess.run(
        [sys.executable, "-m", "tests.ros.tck.run"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_whole_simulator_passes_every_clause(results: dict[str, Any]) -> None:
    clauses = results["clauses"]
    assert {name: told for name, told in clauses.items() if told != "passed"} == {}
    assert len(clauses) > 150


def test_each_violation_is_caught_by_its_clause(results: dict[str, Any]) -> None:
    assert len(results["violations"]) >= 40
    assert set(results["violations"]) - set(results["caught"]) == set()
    several_lines = {name: told for name, told in results["caught"].items() if "\n" in told}
    assert several_lines == {}


def test_simulator_is_left_as_it_was(results: dict[str, Any]) -> None:
    code, printed = results["whole"]
    assert (code, results["left"]) == (0, ["wall"]), printed


def test_results_are_written_as_junit(results: dict[str, Any]) -> None:
    cases = [*ElementTree.fromstring(results["junit"]).iter("testcase")]
    assert len(cases) == 5
    for case in cases:
        told = {entry.get("name"): entry.get("value") for entry in case.iter("property")}
        assert told["feature"] == "DELETING"
        assert ".srv: " in str(told["clause"]) or ".msg: " in str(told["clause"])


def test_simulator_without_features_conforms(results: dict[str, Any]) -> None:
    code, printed = results["bare"]
    rows = [line for line in printed.splitlines() if line.endswith("  not announced")]
    assert (code, len(rows)) == (0, FEATURES), printed
    assert "NOT TESTED GetEntities: test_names_are_unique: needs GetEntities" in printed


def test_announced_service_that_is_missing_is_one_line(results: dict[str, Any]) -> None:
    code, printed = results["boastful"]
    found = [line for line in printed.splitlines() if line.startswith("FAILED ")]
    by_a_string_alone = 1
    assert (code, len(found)) == (1, FEATURES - by_a_string_alone), printed
    assert "       DELETING is announced, but /boastful/delete_entity is not served" in printed
    assert "Traceback" not in printed


def test_served_feature_that_is_not_announced_is_found(results: dict[str, Any]) -> None:
    code, printed = results["modest"]
    found = [line for line in printed.splitlines() if line.startswith("FAILED ")]
    options_of_what_is_not_announced = 8
    assert (code, len(found)) == (1, FEATURES - options_of_what_is_not_announced), printed
    line = "/modest/get_named_poses: expected RESULT_FEATURE_UNSUPPORTED, got RESULT_OK"
    assert line in printed


def test_missing_simulator_is_one_line(results: dict[str, Any]) -> None:
    code, printed = results["none"]
    assert (code, printed.count("no simulator: /nowhere/get_simulator_features")) == (2, 1)
    assert "Fix: start the simulator" in printed
    assert "Traceback" not in printed


def test_kit_depends_on_ros_and_pytest_alone() -> None:
    imported = set()
    for file in SOURCES.rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                imported.add(str(node.module).partition(".")[0])
    assert imported - sys.stdlib_module_names == ALLOWED | MESSAGES


def test_installed_kit_names_what_is_missing(tmp_path: Path) -> None:
    source = tmp_path / "source"
    built = shutil.ignore_patterns("__pycache__", "build", "*.egg-info")
    shutil.copytree(SOURCES.parent, source, ignore=built)
    pip("install", "--no-deps", "--no-build-isolation", "--target", tmp_path / "kit", source)
    done = subprocess.run(
        [sys.executable, "-m", "simulation_interfaces_tck"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path / "kit")},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2, done.stdout
    assert done.stderr.startswith("ERROR: simulation_interfaces not found. Fix: install ROS 2")
