# SPDX-License-Identifier: Apache-2.0
"""`python -m tests.mutants [--only WORD] [--jobs N]`: plant each mutant, run its tests.

A mutant is killed when one of its tests fails. Fails (exit code 1) when fewer than `DEMANDED` of
them are killed, and names the survivors. Each job works in a copy of the repository, so that the
working tree stays as it is.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from .catalog import ROOT, Mutant, catalog

DEMANDED = 0.97
"""The share of mutants that tests must kill."""

SECONDS = 300
"""After this long a test run counts as failed: a mutant that hangs is noticed."""


class Copy:
    """A copy of the repository in which one mutant lives at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, cwd=ROOT, capture_output=True, check=True, text=True).stdout
        built = (str(path.relative_to(ROOT)) for path in _built(ROOT))
        for name in {*filter(None, names.split("\0")), *built}:
            if (ROOT / name).exists():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)

    def fails(self, tests: Iterable[str]) -> bool:
        """Return whether a test fails, or does not end."""
        path = os.pathsep.join((str(self._folder), str(self._folder / "udp-bridge/src")))
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider"]
        try:
            done = subprocess.run(
                # The same examples each time, or a survivor would be a matter of luck.
                [*command, "--hypothesis-seed=0", *tests],
                cwd=self._folder,
                env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
                capture_output=True,
                timeout=SECONDS,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return True
        if done.returncode not in (0, 1, 2):  # 2: a module of tests cannot be imported
            raise RuntimeError(f"pytest {' '.join(tests)}: {done.stdout.decode()[-2000:]}")
        return done.returncode != 0

    def kills(self, mutant: Mutant) -> bool:
        """Plant a mutant, run its tests, take it out again; return whether one failed."""
        source = self._folder / mutant.file
        text = source.read_text(encoding="utf-8")
        try:
            source.write_text(mutant.planted(text), encoding="utf-8")
            if source.suffix in (".c", ".h"):
                self._build(mutant.file)
            return self.fails(mutant.tests.split())
        finally:
            source.write_text(text, encoding="utf-8")
            if source.suffix in (".c", ".h"):
                self._build(mutant.file)

    def _build(self, file: str) -> None:
        """Compile the extension module that a source belongs to, as its distribution would."""
        base = self._folder / ("udp-bridge" if file.startswith("udp-bridge/") else "")
        project = tomllib.loads((base / "pyproject.toml").read_text(encoding="utf-8"))
        [module] = project["tool"]["setuptools"]["ext-modules"]
        [out] = (path for path in _built(base) if path.name.startswith(_stem(module["name"])))
        include = f"-I{sysconfig.get_path('include')}"
        command = ["cc", "-shared", "-fPIC", include, *module["extra-compile-args"]]
        libraries = module.get("extra-link-args", [])
        subprocess.run(
            [*command, *module["sources"], *libraries, "-o", out],
            cwd=base,
            check=True,
            capture_output=True,
        )


def _stem(module: str) -> str:
    return module.rpartition(".")[2] + "."


def _built(base: Path) -> list[Path]:
    """Return the extension modules that were built in place below a folder."""
    return [
        path
        for package in ("services", "src", "udp-bridge/src")
        for path in (base / package).rglob(f"*{sysconfig.get_config_var('EXT_SUFFIX')}")
    ]


def survivors(mutants: Sequence[Mutant], jobs: int) -> list[Mutant]:
    """Return the mutants that no test kills, printing each as it is judged.

    Raises
    ------
    RuntimeError
        when a test fails without any mutant: then nothing can be judged.
    """
    with tempfile.TemporaryDirectory(prefix="mutants-") as place:
        free: SimpleQueue[Copy] = SimpleQueue()
        for job in range(jobs):
            free.put(Copy(Path(place) / str(job)))

        def judged(mutant: Mutant) -> bool:
            copy = free.get()
            try:
                killed = copy.kills(mutant)
            finally:
                free.put(copy)
            print(f"{'killed  ' if killed else 'SURVIVED'}  {mutant.name}", flush=True)
            return killed

        def sound(tests: str) -> bool:
            copy = free.get()
            try:
                return not copy.fails(tests.split())
            finally:
                free.put(copy)

        with ThreadPoolExecutor(jobs) as pool:
            asked = sorted({mutant.tests for mutant in mutants})
            for tests, passed in zip(asked, pool.map(sound, asked), strict=True):
                if not passed:
                    raise RuntimeError(f"without any mutant, {tests} fails")
            verdicts = list(pool.map(judged, mutants))
    return [mutant for mutant, killed in zip(mutants, verdicts, strict=True) if not killed]


def main(arguments: Sequence[str]) -> int:
    """Judge the mutants; return 0 when enough of them are killed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--only", default="", help="mutants whose file or meaning has this in it")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="test runs at a time")
    options = parser.parse_args(arguments)
    mutants = [mutant for mutant in catalog() if options.only in mutant.name]
    if not mutants:
        parser.error(f"no mutant has {options.only!r} in its file or meaning")
    left = survivors(mutants, options.jobs)
    share = 1 - len(left) / len(mutants)
    print(f"{len(mutants) - len(left)} of {len(mutants)} mutants killed, {share:.1%}")
    for mutant in left:
        print(f"survived: {mutant.name}: `{mutant.was}` -> `{mutant.becomes}` ({mutant.tests})")
    return 0 if share >= DEMANDED else 1


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
