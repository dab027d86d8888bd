# SPDX-License-Identifier: Apache-2.0
"""The claims of the distribution: nothing but the standard library, and Python 3.8 can read it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

import udp_bridge

SOURCES = sorted(Path(udp_bridge.__file__).parent.glob("**/*.py"))
ROOT = Path(udp_bridge.__file__).parent
MODULES = [
    ".".join(path.relative_to(ROOT).with_suffix("").parts)
    for path in SOURCES
    if path.stem != "__init__"
]

IMPORT_ALL = """
import importlib, json, sys
sys.path.insert(0, sys.argv[1])
for name in json.loads(sys.argv[2]):
    importlib.import_module("udp_bridge." + name)
print(json.dumps(sorted(name for name in sys.modules if not name.startswith("udp_bridge"))))
"""


def test_nothing_but_the_standard_library_is_imported() -> None:
    source = str(ROOT.parent)
    command = [sys.executable, "-I", "-S", "-c", IMPORT_ALL, source, json.dumps(MODULES)]
    out = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout
    imported = {name.partition(".")[0] for name in json.loads(out)} - {"__main__"}
    assert imported - set(sys.stdlib_module_names) == set()
    assert "socket" in imported


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_python_3_8_can_read_it(path: Path) -> None:
    tree = ast.parse(path.read_text(), feature_version=(3, 8))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    assert imports[0].module == "__future__"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_only_the_shell_reads_clocks_or_opens_sockets(path: Path) -> None:
    imported = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
    shell = {
        "link.py": {"threading", "time"},
        "listening.py": {"time"},
        "worker_thread.py": {"threading", "time"},
        "udp_socket.py": {"socket"},
        "runs.py": {"socket"},
        "departures.py": {"threading", "time"},
        "cli.py": {"threading", "time"},
        "around.py": {"threading", "time"},
        "outlet.py": {"threading", "time"},
        "asking.py": {"threading", "time"},
        "run.py": {"time"},
        "end.py": {"threading", "time"},
        "ros_end/lockstep.py": {"time"},
        "address_guard.py": {"threading", "time"},
    }
    assert imported & {"socket", "threading", "time"} == shell.get(
        f"{path.parent.name}/{path.name}", shell.get(path.name, set())
    )


def test_every_module_has_its_test() -> None:
    tests = {path.stem for path in Path(__file__).parent.glob("test_*.py")}
    elsewhere = {
        "__main__": "test_cli",
        "assembly": "test_reassembly",
        "fec_parts": "test_fec",
        "fec_sending": "test_fec",
        "holdings": "test_reassembly",
        "ordering": "test_reassembly",
        "verdicts": "test_reassembly",
        "resend_budget": "test_resend",
        "resend_want": "test_resend_asking",
        "resend_offers": "test_resend",
        "round_trip": "test_resend_asking",
        "counters": "test_reassembly",
        "reports": "test_control",
        "message": "test_fragments",
        "run_reassembly": "test_placing",
        "leaving": "test_sending",
        "listening": "test_link",
        "peers": "test_receiving",
        "telling": "test_receiving",
        "known_headers": "test_sending",
        "waiting": "test_sending",
        "udp_socket": "test_link",
    }
    for module in MODULES:
        if module.startswith("ros_end."):  # what has its tests with ROS, in tests/ros
            continue
        assert elsewhere.get(module, f"test_{module}") in tests, module
