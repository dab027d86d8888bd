# SPDX-License-Identifier: Apache-2.0
"""Test the C extension modules with AddressSanitizer and UBSan.

`python -m fuzz.sanitized [PYTEST ARGUMENTS]` compiles every extension module of both
`pyproject.toml` files with the sanitizers into a temporary folder and runs tests on them, by
default those that exercise the C code most. The installed modules do not change. Needs gcc.
"""

import importlib.abc
import importlib.util
import os
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path

ROOT = Path(__file__).parents[1]
TESTS = (
    "tests/udp_bridge/io/test_udp_socket.py",
    "tests/udp_bridge/test_delegated_sends.py",
    "tests/udp_bridge/io/test_credit_mailbox.py",
    "tests/bridge/test_fuzz.py::test_batches_of_parts_give_what_single_datagrams_give",
    "tests/services/physics/running_gear",
    "tests/services/physics/simulation/test_memory.py",
    "tests/services/physics/vehicle/test_bumper.py",
    "tests/services/physics/vehicle/test_vehicle.py",
    "tests/services/sensors/rays",
    "tests/services/sensors/scanning",
    # Embree itself is not sanitized; one of its tests checks the data that is passed to it, another
    # compares its speed.
    *("-k", "(not Embree or test_static_world) and not costs_little"),
)
SANITIZERS = (
    *("-O1", "-g", "-fno-omit-frame-pointer", "-fsanitize=address,undefined"),
    # Uninitialized local variables are zero, so that a failure is reproducible.
    *("-fno-sanitize-recover=all", "-ftrivial-auto-var-init=zero"),
)
_FOLDER = "GROUNDLINK_SANITIZED"


def compiled(folder: Path) -> None:
    """Compile every extension module as `folder/<name>.so`; `CalledProcessError` on an error."""
    for project in (ROOT / "pyproject.toml", ROOT / "udp-bridge/pyproject.toml"):
        for module in tomllib.loads(project.read_text())["tool"]["setuptools"]["ext-modules"]:
            own = [flag for flag in module["extra-compile-args"] if not flag.startswith("-O")]
            command = ["gcc", "-shared", "-fPIC", "-pthread", *own, *SANITIZERS]
            command += ["-I", sysconfig.get_paths()["include"]]
            command += [str(project.parent / source) for source in module["sources"]]
            command += ["-o", str(folder / f"{module['name']}.so")]
            command += module.get("extra-link-args", [])
            subprocess.run(command, check=True)


class Finder(importlib.abc.MetaPathFinder):
    """Finds the modules in a folder instead of the installed ones."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.found: set[str] = set()

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        """Return the spec of a sanitized module; None for every other module."""
        file = self._folder / f"{name}.so"
        if not file.exists():
            return None
        self.found.add(name)
        return importlib.util.spec_from_file_location(name, file)


def run(arguments: Sequence[str], folder: Path) -> int:
    """Run tests on the modules in a folder, in a process of its own; return its exit code."""
    # The C++ runtime must be loaded first, so that exceptions of other libraries are caught.
    runtimes = [
        subprocess.run(
            ["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True
        ).stdout.strip()
        for name in ("libasan.so", "libstdc++.so.6")
    ]
    child = {
        "LD_PRELOAD": " ".join(runtimes),
        # Python itself never frees everything. Short stacks and a small quarantine halve the
        # time.
        # Bullet deletes with `delete` what it made with `new[]`.
        "ASAN_OPTIONS": "detect_leaks=0:alloc_dealloc_mismatch=0:malloc_context_size=8"
        ":quarantine_size_mb=32",
        "UBSAN_OPTIONS": "print_stacktrace=1",
        _FOLDER: str(folder),
    }
    command = [sys.executable, "-m", "fuzz.sanitized", *(arguments or TESTS)]
    return subprocess.run(command, cwd=ROOT, env=os.environ | child, check=False).returncode


def main() -> int:
    """Compile and run, or, in the child, run the tests."""
    if _FOLDER in os.environ:
        import pytest

        finder = Finder(Path(os.environ[_FOLDER]))
        sys.meta_path.insert(0, finder)
        # A sanitizer writes to the file descriptor of stderr, which must not be captured.
        code = pytest.main(["-q", "-p", "no:cacheprovider", "--capture=sys", *sys.argv[1:]])
        print("with sanitizers:", *sorted(finder.found))
        return code
    with tempfile.TemporaryDirectory() as folder:
        compiled(Path(folder))
        return run(sys.argv[1:], Path(folder))


if __name__ == "__main__":
    sys.exit(main())
