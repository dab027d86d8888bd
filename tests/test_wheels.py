# SPDX-License-Identifier: Apache-2.0
"""Wheels installed with each extra alone: every command works or names the extra it needs."""

import json
import os
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from tests.building import REPOSITORY, build_wheels, pip

EXTRAS = (
    *(
        "physics",
        "sensors",
        "camera",
        "gateway",
        "record",
        "export",
        "view",
        "report",
        "search",
        "secure",
    ),
    "run",
    "all",
)

OTHER_EXTRAS = {"ros2", "gym", "osc", "benchmarks", "experiments", "docs", "dev"}
"""For a checkout, or of other programs."""

COMMANDS: dict[str, str | None] = {
    "--help": None,
    "up --help": None,
    "demo --duration 0": "all",
    "new my_scenario": None,
    "sweep": None,
    "campaign indoor_lab --check true --out found --jobs 0": "search",
    "search indoor_lab --vary seed=1..3 --budget 1 --out found --jobs 0": "search",
    "topics": None,
    "schema": None,
    "compose indoor_lab": None,
    "check nowhere.yaml": None,
    "check indoor_lab": "gateway",
    "sensors": "gateway",
    "sensors show vlp16": "gateway",
    "up indoor_lab --no-ros --duration 0": None,
    "record indoor_lab --out run.mcap --duration 0": None,
    "snapshot indoor_lab rover/nothing": None,
    "replay nowhere.mcap": "record",
    "convert nowhere.mcap run.bag": "record",
    "export nowhere.mcap --out run": "export",
    "verify nowhere.mcap indoor_lab": "record",
    "report nowhere.mcap": "report",
    "secure indoor_lab credentials": "secure",
    "world import heights.png --heights-m 0 1 --cell-m 1": "physics",
    "world import cube.stl": "physics",
    "-m services.physics --help": "physics",
    "-m services.physics.trials --help": "physics",
    "-m services.sensors --help": None,
    "-m services.sensors.lidar --help": None,
    "-m services.sensors.camera --help": None,
    "-m services.gateway --help": "gateway",
    "-m services.link --help": None,
    "-m services.recorder --help": "record",
    "-m services.replay --help": "record",
    "-m services.router --help": None,
    "-m services.driver --help": None,
    "-m services.view --help": None,
}
"""Each command with the extra it needs."""

RUN_ALL = """
import contextlib, io, json, runpy, sys, traceback
results = {}
for command in json.loads(sys.argv[1]):
    words = command.split()
    module = words.pop(1) if words[0] == "-m" else "groundlink"
    sys.argv[1:] = words[words[:1] == ["-m"]:]
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            runpy.run_module(module, run_name="__main__", alter_sys=True)
            code = 0
        except SystemExit as end:
            code = end.code or 0
        except BaseException:
            traceback.print_exc()
            code = 1
    results[command] = code, said.getvalue()
print(json.dumps(results))
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders with the installed wheel of each of our distributions."""
    source = tmp_path_factory.mktemp("source")
    out = build_wheels(source)
    folders = {}
    for name in ("groundlink", "udp-bridge"):
        (wheel,) = out.glob(f"{name.replace('-', '_')}-*.whl")
        folders[name] = source / "installed" / name
        pip("install", "--no-deps", "--no-index", "--target", folders[name], wheel)
    return folders


@pytest.mark.parametrize("extra", [None, *EXTRAS])
def test_every_command_works_or_names_its_extra(
    installed: dict[str, Path], tmp_path: Path, extra: str | None
) -> None:
    python = _environment(tmp_path / "environment", installed, extra)
    here = tmp_path / "here"
    here.mkdir()
    _inputs(here)
    done = subprocess.run(
        [python, "-c", RUN_ALL, json.dumps([*COMMANDS])],
        cwd=here,
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for command, (code, said) in json.loads(done.stdout).items():
        needed = COMMANDS[command]
        where = f"{command} with {extra}: {code} {said}"
        assert "Traceback" not in said, where
        if needed == extra or needed is None:
            assert code in (0, 2), where
            assert "pip install" not in said, where
        elif extra is None:
            assert code == 3, where
        if code == 3:  # Another extra may bring enough of the packages.
            assert said.count("\n") == 1 + command.startswith("world import"), where
            assert f"pip install 'groundlink[{needed}]'" in said, where


def test_wheel_contains_every_data_file(installed: dict[str, Path]) -> None:
    sources = {".py", ".pyc", ".c", ".h", ".so"}
    expected = {
        file.relative_to(REPOSITORY).as_posix()
        for folder in ("groundlink", "services")
        for pattern in ("*", "shipped/**/*")
        for file in (REPOSITORY / folder).rglob(pattern)
        if file.is_file() and file.suffix not in sources
    }
    assert {"page.html", "lab.yaml", "surface.frag"} <= {Path(file).name for file in expected}
    own = installed["groundlink"]
    assert expected - {file.relative_to(own).as_posix() for file in own.rglob("*")} == set()


def test_every_extra_and_every_process_is_tried() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert set(project["optional-dependencies"]) == {*EXTRAS, *OTHER_EXTRAS}
    modules = {file.parent.name for file in (REPOSITORY / "services").glob("*/__main__.py")}
    assert {c.split()[1].split(".")[1] for c in COMMANDS if c.startswith("-m")} == modules


def _inputs(folder: Path) -> None:
    """Write files that commands take."""
    from PIL import Image

    Image.new("L", (8, 8)).save(folder / "heights.png")
    corners = "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0"
    triangle = f"facet normal 0 0 1\nouter loop\n{corners}\nendloop\nendfacet"
    (folder / "cube.stl").write_text(f"solid s\n{triangle}\nendsolid s\n", encoding="ascii")


def _environment(folder: Path, installed: dict[str, Path], extra: str | None) -> Path:
    """Return the Python of an environment with what `pip install groundlink[extra]` brings.

    Ours are linked from where they were installed, dependencies from this environment: no network
    is needed.
    """
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    site = next(folder.glob("lib/python*/site-packages"))
    own = installed["groundlink"]
    ours = next(iter(metadata.distributions(name="groundlink", path=[str(own)])))
    for name in ("groundlink", *_brought(ours, extra or "", set())):
        if name in installed:
            tops = {path.name: path for path in installed[name].iterdir()}
        else:
            there = metadata.distribution(name)
            files = {file.parts[0] for file in there.files or () if file.parts[0] != ".."}
            tops = {top: Path(str(there.locate_file(top))) for top in files}
        for top in tops.keys() - {"__pycache__"}:
            if not (site / top).exists():
                (site / top).symlink_to(tops[top].resolve())
    return folder / "bin" / "python"


def _brought(what: metadata.Distribution, extra: str, found: set[str]) -> Iterator[str]:
    """Yield the names of all distributions that one brings with an extra."""
    for line in what.requires or ():
        needed = Requirement(line)
        if line in found or not (needed.marker is None or needed.marker.evaluate({"extra": extra})):
            continue
        found.add(line)
        yield needed.name
        inner = what if needed.name == what.name else metadata.distribution(needed.name)
        for more in ("", *needed.extras):
            yield from _brought(inner, more, found)
