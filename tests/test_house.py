# SPDX-License-Identifier: Apache-2.0
"""The house rules are tests: style, types, the direction of imports, sizes, and honest files."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = (
    "groundlink",
    "services",
    "udp-bridge/src",
    "ros/ros1",
    "ros/ros2",
    "benchmarks",
    "experiments",
)
FILES = [
    file
    for folder in (*SOURCES, "tests", "fuzz")
    for file in sorted((ROOT / folder).rglob("*.py"))
    if "build" not in file.relative_to(ROOT).parts
]

PAGES = [
    page
    for folder in ("", "docs", "deploy", "ros/ros1", "ros/ros2", "udp-bridge", "udp-bridge/csharp")
    for page in sorted((ROOT / folder).glob("*.md"))
]


def run(*command: str) -> None:
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_style() -> None:
    run("-m", "ruff", "check", ".")
    run("-m", "ruff", "format", "--check", ".")


def test_types() -> None:
    run("-m", "mypy", "groundlink", "services", "benchmarks", "experiments")
    run("-m", "mypy", "udp-bridge/src/udp_bridge")
    run("-m", "mypy", "ros/ros1/udp_bridge_ros1/src/udp_bridge_ros1")
    run("-m", "mypy", "ros/ros2/udp_bridge_ros2/udp_bridge_ros2")


def test_imports_run_one_way() -> None:
    path = "import sys; sys.path.append('ros/ros1/udp_bridge_ros1/src')\n"
    run("-c", path + "from importlinter.cli import lint_imports_command as run; run()")


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(ROOT)))
def test_a_file_says_its_licence(file: Path) -> None:
    first = file.read_text(encoding="utf-8").partition("\n")[0]
    assert first == "# SPDX-License-Identifier: Apache-2.0"


@pytest.mark.parametrize(
    "file",
    [f for f in FILES if "tests" not in f.relative_to(ROOT).parts],
    ids=lambda file: str(file.relative_to(ROOT)),
)
def test_a_module_states_its_rule_and_stays_small(file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)), "no module docstring"
    assert text.count("\n") <= 350, "is this one thing?"


def test_models_read_no_clock() -> None:
    """Time is an argument below the processes' shells."""
    shells = {"shell.py", "native.py", "__main__.py", "authority.py", "gateway.py"}
    shells |= {"emulated.py", "relay.py"}
    for file in FILES:
        parts = file.relative_to(ROOT).parts
        if parts[0] == "services" and file.name not in shells:
            names = {
                alias.name
                for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
                if isinstance(node, ast.Import)
                for alias in node.names
            }
            assert not names & {"time", "datetime", "socket", "random"}, file


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_what_a_page_points_at_is_there(page: Path) -> None:
    targets = re.findall(r"\]\(([^)#\s]+)", page.read_text(encoding="utf-8"))
    near = [target for target in targets if "://" not in target and ":" not in target]
    assert [target for target in near if not (page.parent / target).exists()] == []
