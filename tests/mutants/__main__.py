# SPDX-License-Identifier: Apache-2.0
"""`python -m tests.mutants [--only WORD] [--jobs N]`: plant each mutant, run its tests.

A mutant is killed when one of its tests fails. Fails (exit code 1) when fewer than `DEMANDED` of
them are killed, and names the survivors. Each job works in a copy of the repository, so that the
working tree stays as it is.
"""

import argparse
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, nullcontext
from pathlib import Path
from queue import SimpleQueue

from . import warm
from .catalog import ROOT, Mutant, catalog

DEMANDED = 0.97
"""The share of mutants that tests must kill."""


class Copy:
    """A copy of the repository that holds one mutant at a time."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        names = subprocess.run(listed, cwd=ROOT, capture_output=True, check=True, text=True).stdout
        built = (str(path.relative_to(ROOT)) for path in _built(ROOT))
        for name in {*filter(None, names.split("\0")), *built}:
            if (ROOT / name).exists():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)

        path = os.pathsep.join((str(folder), str(folder / "udp-bridge/src")))
        self._pytest = subprocess.Popen(
            [sys.executable, "-m", "tests.mutants.warm"],
            cwd=folder,
            env=os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def close(self) -> None:
        """End what runs the tests."""
        self._pytest.communicate()

    def failure(self, tests: Iterable[str]) -> str:
        """Return what pytest says of the first test that fails or does not end; "" if none does."""
        assert self._pytest.stdin
        assert self._pytest.stdout
        # The same examples each time, or a survivor would be a matter of luck.
        options = "-x -q -p no:cacheprovider --hypothesis-seed=0"
        print(options, *tests, file=self._pytest.stdin, flush=True)
        code = int(self._pytest.stdout.readline())
        said = (self._folder / warm.SAID).read_text(encoding="utf-8", errors="replace")[-2000:]
        if code > 2:  # 1: a test fails; 2: a module of tests cannot be imported
            raise RuntimeError(f"pytest {' '.join(tests)}: {said}")
        return f"{said}\nexit code {code}" if code else ""

    def kills(self, mutant: Mutant) -> bool:
        """Plant a mutant, run its tests, take it out again; return whether one failed."""
        source = self._folder / mutant.file
        text = source.read_text(encoding="utf-8")
        try:
            source.write_text(mutant.planted(text), encoding="utf-8")
            with self._compiled(mutant.file) if source.suffix == ".c" else nullcontext():
                return bool(self.failure(mutant.tests.split()))
        finally:
            source.write_text(text, encoding="utf-8")

    @contextmanager
    def _compiled(self, file: str) -> Iterator[None]:
        """Compile the extension module that a source belongs to, as its distribution would."""
        beside = "udp-bridge/" if file.startswith("udp-bridge/") else ""
        base, source = self._folder / beside, file.removeprefix(beside)
        project = tomllib.loads((base / "pyproject.toml").read_text(encoding="utf-8"))
        modules = project["tool"]["setuptools"]["ext-modules"]
        [module] = (module for module in modules if source in module["sources"])
        stem = module["name"].replace(".", "/") + "."
        [out] = (path for path in _built(base) if stem in path.as_posix())
        before = out.read_bytes()
        include = f"-I{sysconfig.get_path('include')}"
        command = ["cc", "-shared", "-fPIC", include, *module["extra-compile-args"]]
        libraries = module.get("extra-link-args", [])
        subprocess.run(
            [*command, *module["sources"], *libraries, "-o", out],
            cwd=base,
            check=True,
            capture_output=True,
        )
        try:
            yield
        finally:
            out.write_bytes(before)


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
        copies = [Copy(Path(place) / str(job)) for job in range(jobs)]
        free: SimpleQueue[Copy] = SimpleQueue()
        for copy in copies:
            free.put(copy)

        def judged(mutant: Mutant) -> bool:
            copy = free.get()
            try:
                killed = copy.kills(mutant)
            finally:
                free.put(copy)
            print(f"{'killed  ' if killed else 'SURVIVED'}  {mutant.name}", flush=True)
            return killed

        def unsound(tests: Sequence[str]) -> str:
            copy = free.get()
            try:
                return copy.failure(tests)
            finally:
                free.put(copy)

        with ThreadPoolExecutor(jobs) as pool:
            asked = sorted({test for mutant in mutants for test in mutant.tests.split()})
            shares = filter(None, (asked[job::jobs] for job in range(jobs)))
            if failures := "\n".join(filter(None, pool.map(unsound, shares))):
                raise RuntimeError(f"a test fails without any mutant:\n{failures}")
            print(f"{len(asked)} tests pass without a mutant", flush=True)
            verdicts = list(pool.map(judged, mutants))
        for copy in copies:
            copy.close()
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
