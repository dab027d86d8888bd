# SPDX-License-Identifier: Apache-2.0
"""Commits of a git repository: their order, and temporary worktrees. No branch or file changes."""

import os
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

from groundlink.core.errors import RequirementError, UserError


class Commit(NamedTuple):
    """Description of a commit."""

    sha: str
    author: str
    date: str
    """ISO 8601."""

    subject: str


class Repository:
    """A git repository as an order of commits.

    Parameters
    ----------
    folder
        any folder of its working tree, or a bare repository.

    Raises
    ------
    UserError
        if the folder is in no repository.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        if not folder.is_dir():
            raise UserError(
                f"--repository {folder}: no such folder. Fix: pass the folder of a git repository"
            )
        is_bare = self._git("rev-parse", "--is-inside-work-tree") == "false"
        self.tree = None if is_bare else Path(self._git("rev-parse", "--show-toplevel"))
        """Root of the working tree; None in a bare repository."""

    def resolve(self, revision: str) -> str:
        """Return the full hash of a commit.

        Raises
        ------
        UserError
            if there is none.
        """
        return self._git("rev-parse", "--verify", f"{revision}^{{commit}}")

    def check_ancestor(self, good: str, bad: str) -> None:
        """Check that the history of one commit has another one.

        Raises
        ------
        UserError
            if not.
        """
        if self.distance(bad, good) > 0:
            raise UserError(
                f"--good {good[:12]} is no ancestor of --bad {bad[:12]}. Fix: choose a commit of "
                f"its history, such as `git merge-base {good[:12]} {bad[:12]}`"
            )

    def distance(self, good: str, bad: str) -> int:
        """Return the number of commits in the history of `bad` that are not in that of `good`."""
        return int(self._git("rev-list", "--count", bad, f"^{good}"))

    def between(self, good: Sequence[str], bad: str) -> Iterator[str]:
        """Yield the open commits below a bad one, the one that halves them best first.

        Git knows the history as a graph, so merges are no special case.
        """
        listed = self._git("rev-list", "--bisect-all", bad, *(f"^{each}" for each in good))
        for line in listed.splitlines():
            commit = line.split()[0]
            if commit != bad:
                yield commit

    def describe(self, commit: str) -> Commit:
        """Return the description of a commit."""
        form = "%H%n%an%n%aI%n%s"
        return Commit(*self._git("log", "-1", f"--format={form}", commit).split("\n", 3))

    @contextmanager
    def worktree(self, commit: str) -> Iterator[Path]:
        """Yield a temporary folder with the files of a commit, without submodules."""
        with tempfile.TemporaryDirectory(prefix="groundlink-bisect-") as temporary:
            folder = Path(temporary) / "tree"
            # A hook of the user could change the run.
            quiet = ("-c", "core.hooksPath=/dev/null", "worktree")
            try:
                self._git(*quiet, "add", "--quiet", "--detach", str(folder), commit)
                yield folder
            finally:
                with suppress(UserError):  # Git had not added it.
                    self._git(*quiet, "remove", "--force", str(folder))

    def _git(self, *words: str) -> str:
        """Return the output of a git command."""
        inherited = {k: v for k, v in os.environ.items() if not k.startswith("GIT_")}
        try:
            done = subprocess.run(
                ["git", "-C", str(self._folder), *words],
                env=inherited,
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
            )
        except FileNotFoundError:
            raise RequirementError("--repository: git is not installed. Fix: install it") from None
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["git failed"])[-1]
            raise UserError(f"--repository {self._folder}: {reason}")
        return done.stdout.strip()
