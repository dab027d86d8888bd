# SPDX-License-Identifier: Apache-2.0
"""The house rules are tests: style, types, the direction of imports, sizes, and honest files."""

import ast
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = (
    "groundlink",
    "services",
    "udp-bridge/src",
    "ros/ros1",
    "ros/ros2",
    "ros/simulation_interfaces_tck",
    "conformance",
    "benchmarks",
    "experiments",
    "tools",
)
FILES = [
    file
    for folder in (*SOURCES, "tests", "fuzz")
    for file in sorted((ROOT / folder).rglob("*.py"))
    if "build" not in file.relative_to(ROOT).parts
]

_PAGES_IN = ("docs", "conformance", "deploy", "examples", "ros", "udp-bridge", ".github")
PAGES = sorted(
    [*ROOT.glob("*.md"), *(page for name in _PAGES_IN for page in (ROOT / name).rglob("*.md"))]
)


def read(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def run(*command: str) -> None:
    done = subprocess.run(
        [sys.executable, *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_style() -> None:
    run("-m", "ruff", "check", ".")
    run("-m", "ruff", "format", "--check", ".")


@pytest.mark.timeout(400)  # Without mypy's cache, on busy cores.
def test_types() -> None:
    run(
        *("-m", "mypy", "groundlink", "services", "benchmarks", "experiments", "tools"),
        "udp-bridge/src/udp_bridge",
        "ros/ros1/udp_bridge_ros1/src/udp_bridge_ros1",
        "ros/ros2/udp_bridge_ros2/udp_bridge_ros2",
        "ros/simulation_interfaces_tck/src/simulation_interfaces_tck",
        "conformance/src/sensor_conformance",
    )


def test_imports_run_one_way() -> None:
    path = "import sys; sys.path.append('ros/ros1/udp_bridge_ros1/src')\n"
    run("-c", path + "from importlinter.cli import lint_imports_command as run; run()")


def test_every_file_names_its_license() -> None:
    line = "# SPDX-License-Identifier: Apache-2.0"
    without = [file for file in FILES if read(file).partition("\n")[0] != line]
    assert without == []


def test_every_module_has_a_docstring_and_stays_small() -> None:
    modules = {file: read(file) for file in FILES if "tests" not in file.relative_to(ROOT).parts}
    assert [file for file, text in modules.items() if not ast.get_docstring(ast.parse(text))] == []
    assert [file for file, text in modules.items() if text.count("\n") > 500] == []


def test_folders_stay_narrow() -> None:
    """A package's face and its entry point do not count; headers and C files do."""
    sources = (*SOURCES, "fuzz")
    kinds = {".py", ".c", ".h", ".hpp", ".cpp", ".cs"}
    files = [
        file
        for folder in sources
        for file in (ROOT / folder).rglob("*")
        if file.suffix in kinds and "build" not in file.relative_to(ROOT).parts
    ]
    widths = Counter(file.parent for file in files if file.name != "__init__.py")
    assert {folder: width for folder, width in widths.items() if width > 18} == {}


def test_public_classes_have_names_of_their_own() -> None:
    named: dict[str, list[Path]] = {}
    for file in FILES:
        if "tests" in file.relative_to(ROOT).parts:
            continue
        for node in ast.walk(ast.parse(read(file))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                named.setdefault(node.name, []).append(file)
    assert {name: files for name, files in named.items() if len(files) > 1} == {}


def impurities(text: str) -> set[str]:
    """Return what a module takes from clocks, sockets or global generators, however written."""
    packages: set[str] = set()
    attributes: set[str] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            packages |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            packages.add((node.module or "").partition(".")[0])
        elif isinstance(node, ast.Attribute):
            attributes.add(node.attr)
    # datetime.now() reads a clock, datetime.fromtimestamp() does not.
    return packages & {"time", "socket", "random"} | attributes & {"now", "today", "utcnow"}


@pytest.mark.parametrize(
    "text",
    [
        "import time",
        "import time as clock",
        "from time import monotonic",
        "def f():\n    from random import random",
        "import sys, socket",
        "from datetime import datetime\nat = datetime.now()",
    ],
)
def test_a_clock_is_found_however_it_is_written(text: str) -> None:
    assert impurities(text)


def test_models_read_no_clock() -> None:
    """Time is an argument below the processes' outermost modules."""
    outermost = {"runner.py", "process.py", "__main__.py", "server.py", "gateway.py"}
    outermost |= {"carrier.py", "emulated_socket.py", "relay.py"}
    services = [file for file in FILES if file.relative_to(ROOT).parts[0] == "services"]
    inner = [file for file in services if file.name not in outermost]
    assert {file: found for file in inner if (found := impurities(read(file)))} == {}


def anchors(text: str) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    found: Counter[str] = Counter()
    slugs = set()
    for heading in re.findall(r"^#{1,6} +(.+?) *#*$", text, flags=re.MULTILINE):
        words = re.sub(r"!?\[([^]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        slugs.add(f"{slug}-{found[slug]}" if found[slug] else slug)
        found[slug] += 1
    return slugs


@pytest.mark.parametrize(
    ("heading", "anchor"),
    [
        ("## Why `TRANSIENT_LOCAL`, and when", "why-transient_local-and-when"),
        ("# [Zenoh](https://zenoh.io) 1.x - the bus", "zenoh-1x---the-bus"),
        ("# One\n## Two\n## Two", "two-1"),
    ],
)
def test_anchor_of_a_heading(heading: str, anchor: str) -> None:
    assert anchor in anchors(heading)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_resolve(page: Path) -> None:
    missing = []
    for target in re.findall(r"\]\(([^)\s]+)", read(page)):
        path, _, anchor = target.partition("#")
        file = page.parent / path if path else page
        if ":" not in target and not (
            file.exists() and (not anchor or file.suffix != ".md" or anchor in anchors(read(file)))
        ):
            missing.append(target)
    assert missing == []


OWN = ("groundlink", "services", "udp_bridge")


def loaded_by(*modules: str) -> dict[str, str]:
    """Return our own modules that a process loads to import some, each with its importer."""
    program = "; ".join(f"import {module}" for module in modules)
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", program],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    importers: dict[str, str] = {}
    path: list[str] = []
    # A module follows those that it imports, which are indented by two more columns.
    for line in reversed(done.stderr.splitlines()):
        indented = line.rpartition("|")[2][1:]
        name = indented.strip()
        path[(len(indented) - len(name)) // 2 :] = [name]
        if name.partition(".")[0] in OWN:
            importers[name] = path[-2] if len(path) > 1 else "the process"
    return importers


@pytest.mark.parametrize(
    ("modules", "most"),
    [
        (("services.router.__main__",), 27),
        (("services.sensors.imu.__main__", "services.sensors.imu.model"), 109),
        (("services.gateway.__main__",), 171),
    ],
    ids=["router", "imu", "gateway"],
)
def test_a_process_imports_what_it_needs(modules: tuple[str, ...], most: int) -> None:
    loaded = loaded_by(*modules)
    listed = "\n".join(f"{name} (imported by {by})" for name, by in sorted(loaded.items()))
    assert modules[0] in loaded
    assert len(loaded) <= most, f"{len(loaded)} modules, expected at most {most}:\n{listed}"


@pytest.mark.parametrize(
    "service", ["driver", "gateway", "link", "recorder", "replay", "router", "sensors", "view"]
)
def test_only_physics_and_the_command_line_read_scenario_files(service: str) -> None:
    loaded = loaded_by(f"services.{service}.__main__")
    readers = {
        name: by
        for name, by in loaded.items()
        if name.startswith(("groundlink.loader", "groundlink.importing"))
    }
    assert readers == {}
