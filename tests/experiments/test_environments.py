# SPDX-License-Identifier: Apache-2.0
"""Environments of programs: made once, refused with a line that says what to do."""

from dataclasses import replace
from pathlib import Path

import pytest

from experiments.estimation import environments
from experiments.estimation.programs import DEBIAN_PACKAGES, DRIVERS, EVO, PROGRAMS, ExternalProgram
from experiments.output.console import Console
from groundlink.core.errors import UserError

SAY = Console()


def made(out: Path, program: ExternalProgram) -> None:
    """What an environment leaves when it was made, with a Python from another folder."""
    folder = out / "environments" / program.name
    (folder / "bin").mkdir(parents=True)
    (folder / "bin" / "python").symlink_to("/bin/sh")
    (folder / "installed.txt").write_text("\n".join(program.requirements) + "\n", encoding="utf-8")


def test_an_environment_that_is_there_is_used(tmp_path: Path) -> None:
    made(tmp_path, EVO)
    assert environments.python_of(EVO, tmp_path, SAY).exists()


def test_other_requirements_are_another_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(tmp_path, EVO)

    def create(folder: Path, with_pip: bool) -> None:
        raise UserError("made anew")

    monkeypatch.setattr(environments.venv, "create", create)
    with pytest.raises(UserError, match="made anew"):
        environments.python_of(replace(EVO, requirements=("evo==1.0",)), tmp_path, SAY)


def test_a_library_that_is_missing_is_named_with_its_package(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(DEBIAN_PACKAGES, "libNobodyHasThis.so.9", "libnobodyhasthis9")
    program = replace(EVO, libraries=("libc.so.6", "libNobodyHasThis.so.9"))
    with pytest.raises(UserError, match=r"apt install libnobodyhasthis9$"):
        environments.check_libraries(program)


@pytest.mark.parametrize("program", PROGRAMS.values(), ids=list(PROGRAMS))
def test_every_program_is_pinned_and_has_its_script(program: ExternalProgram) -> None:
    assert all("==" in word for word in program.requirements if not word.startswith("--"))
    assert not program.driver or (DRIVERS / program.driver).is_file()
    assert set(program.libraries) <= set(DEBIAN_PACKAGES)
    assert program.license


def test_failed_program_is_reported_with_its_last_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made(tmp_path, EVO)
    script = tmp_path / "script.sh"
    script.write_text("echo progress 1 of 2; echo it went wrong; exit 3\n", encoding="utf-8")
    monkeypatch.setattr(environments, "DRIVERS", tmp_path)
    program = replace(EVO, driver="script.sh")
    with pytest.raises(UserError, match=r"evo ended with 3(.|\n)*it went wrong"):
        environments.run(program, [], tmp_path, SAY, label="x", log=tmp_path / "log")
    script.write_text("echo $1\n", encoding="utf-8")
    printed = environments.run(program, ["word"], tmp_path, SAY, label="x", log=tmp_path / "log")
    assert printed == "word\n"
    script.write_text("sleep 5\n", encoding="utf-8")
    with pytest.raises(UserError, match="timeout after"):
        environments.run(program, [], tmp_path, SAY, label="x", log=tmp_path / "log", limit_s=0.05)
