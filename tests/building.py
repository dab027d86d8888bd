# SPDX-License-Identifier: Apache-2.0
"""Wheels of our distributions, built from a copy without anything that was built here."""

import shutil
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]


def build_wheels(source: Path) -> Path:
    """Copy the sources to a folder and return the folder below it with their wheels."""
    built = shutil.ignore_patterns("__pycache__", "*.so", "build", "*.egg-info")
    for folder in ("groundlink", "services", "scenarios", "udp-bridge"):
        shutil.copytree(REPOSITORY / folder, source / folder, symlinks=True, ignore=built)
    for file in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(REPOSITORY / file, source)
    out = source / "wheels"
    ours = (source, source / "udp-bridge")
    pip("wheel", "--no-deps", "--no-build-isolation", "-w", out, *ours)
    return out


def pip(*words: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "-q", *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
