# SPDX-License-Identifier: Apache-2.0
"""The claims of the distribution: nothing but the standard library, and Python 3.8 can read it."""

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
    imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert not imports or imports[0].module == "__future__"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.name)
def test_only_the_outermost_modules_read_clocks_or_open_sockets(path: Path) -> None:
    imported = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
    allowed = {
        "cli.py": {"threading", "time"},
        "io/address_guard.py": {"threading", "time"},
        "io/link.py": {"threading", "time"},
        "io/receive_thread.py": {"time"},
        "io/socket_wrappers.py": {"threading", "time"},
        "io/udp_socket.py": {"socket"},
        "io/worker_thread.py": {"threading", "time"},
        "node/command_client.py": {"threading", "time"},
        "node/bridge_node.py": {"threading", "time"},
        "node/lockstep.py": {"time"},
        "node/publish_queue.py": {"threading", "time"},
        "node/run_control.py": {"time"},
    }
    used = imported & {"socket", "threading", "time"}
    assert used == allowed.get(str(path.relative_to(ROOT)), set())


def test_every_module_has_its_test() -> None:
    tests = {path.stem for path in Path(__file__).parent.rglob("test_*.py")}
    elsewhere = {
        "__main__": "test_cli",
        "io.native": "test_udp_socket",
        "io.receive_thread": "test_link",
        "sender.direct_senders": "test_send_queue",
        "sender.waiting": "test_send_queue",
        "receiver.assembly": "test_reassembly",
        "receiver.delivery": "test_reassembly",
        "receiver.delivery_reports": "test_inbox",
        "receiver.limits": "test_reassembly",
        "receiver.ordering": "test_reassembly",
        "receiver.peers": "test_inbox",
        "wire.message": "test_fragments",
        "wire.reports": "test_control",
    }
    for module in MODULES:
        if module.startswith("node."):  # what has its tests with ROS, in tests/ros
            continue
        name = module.rpartition(".")[2]
        assert elsewhere.get(module, f"test_{name}") in tests, module
