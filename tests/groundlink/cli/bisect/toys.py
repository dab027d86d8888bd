# SPDX-License-Identifier: Apache-2.0
"""Toys of the tests: a git repository with a history, and a recording that costs no run."""

import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

RECORDING = Path(__file__).parents[4] / "tests" / "compatibility" / "every_kind.mcap"
"""A recording of every kind of sensor, 0.6 s."""


class ToyRepository:
    """A git repository with one file, `speed`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True)
        self.git("init", "--quiet", "--initial-branch=main")

    def git(self, *words: str) -> str:
        """Return the output of a git command."""
        who = ("-c", "user.name=Ada", "-c", "user.email=ada@example.org")
        done = subprocess.run(
            ["git", "-C", str(self.folder), *who, *words],
            check=True,
            capture_output=True,
            text=True,
        )
        return done.stdout.strip()

    def commit(self, subject: str, files: Mapping[str, str]) -> str:
        """Write files and commit them; return the hash."""
        for name, text in files.items():
            (self.folder / name).write_text(text, encoding="utf-8")
        self.git("add", "--all")
        self.git("commit", "--quiet", "--allow-empty", f"--message={subject}")
        return self.git("rev-parse", "HEAD")

    def commits(self, speeds: Sequence[float], files: Mapping[str, str]) -> list[str]:
        """Commit a speed after the other; return the hashes."""
        return [
            self.commit(f"change {number}", {**files, "speed": str(speed)})
            for number, speed in enumerate(speeds)
        ]
