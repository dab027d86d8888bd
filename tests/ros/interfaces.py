# SPDX-License-Identifier: Apache-2.0
"""Interface packages, built for tests that need them, outside the environment.

Nothing is installed, so that all other tests have a ROS without them: who wants one puts its folder
into PYTHONPATH. It is kept between runs for as long as its sources and the build stay the same.
"""

import fcntl
import importlib
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from .bodies import ROS_FOLDER

SOURCES = Path(__file__).resolve().parent / "simulation_interfaces"
VISION_MSGS = ROS_FOLDER / "vision_msgs"


def simulation_interfaces(cache: Path) -> Path:
    """Return a folder for PYTHONPATH that holds the package."""
    return built(SOURCES, cache)


def built(sources: Path, cache: Path) -> Path:
    """Return a folder for PYTHONPATH that holds the package of some sources."""
    command = [sys.executable, "-m", "tests.ros.interfaces", str(sources), str(cache)]
    done = subprocess.run(command, text=True, stdout=subprocess.PIPE, check=True, timeout=300)
    return Path(done.stdout.splitlines()[-1])


def main(sources: Path, cache: Path) -> None:
    """Build it where `cache` lacks it, and print the folder: the generators are a world of their
    own, with warnings, so they get a process."""
    sys.path.append(str(ROS_FOLDER / "ros2"))
    builder = importlib.import_module("build_messages")
    package = builder.InterfacePackage(sources)
    folder = cache / package.content_hash()
    with (cache / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # tests in another process may need it at the same time
        if not folder.is_dir():
            build_into(folder, package, builder)
    print(folder)


def build_into(folder: Path, package: Any, builder: Any) -> None:
    with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
        build = Path(scratch)
        builder.generate(package, build)
        libraries = builder.compile_sources(package, build)
        modules = build / "py" / package.name
        for library in libraries.glob("*.so"):  # they look for each other beside themselves
            shutil.copy(library, modules)
        modules.parent.rename(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
