# SPDX-License-Identifier: Apache-2.0
"""How the command ends: interrupts and what the system refuses are one line, and leave no file."""

import errno
import os
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from groundlink.__main__ import main
from groundlink.cli import commands
from groundlink.cli.files import topics
from groundlink.core.atomic_file import write_atomically
from groundlink.core.errors import UserError

SLOW = """
import sys, time
from pathlib import Path
from groundlink.__main__ import main
from groundlink.cli.files import topics
from groundlink.core.atomic_file import write_atomically

def slow(options):
    with write_atomically(Path("out.txt")) as part:
        part.write_text("half")
        print("ready", flush=True)
        time.sleep(60)

topics.topics = slow
sys.exit(main(["topics"]))
"""

LIMITED = """
import resource, sys
resource.setrlimit(getattr(resource, sys.argv[1]), (int(sys.argv[2]),) * 2)
from groundlink.__main__ import main
sys.exit(main(sys.argv[3:]))
"""


@pytest.mark.parametrize(("number", "line"), [(2, "groundlink: interrupted\n"), (15, "")])
def test_a_signal_ends_a_command_with_its_code_and_without_a_file(
    tmp_path: Path, number: int, line: str
) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout
    assert process.stdout.readline() == "ready\n"
    assert list(tmp_path.iterdir())
    process.send_signal(number)
    _, error = process.communicate(timeout=30)
    assert process.returncode == 128 + number
    assert error == line
    assert not list(tmp_path.iterdir())


def test_an_interrupt_while_modules_are_imported_is_one_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(commands, "parser", interrupted)
    assert main(["topics"]) == 130
    assert capsys.readouterr().err == "groundlink: interrupted\n"


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "a.bag"), "a.bag: no space left on"),
        (OSError(errno.EROFS, os.strerror(errno.EROFS), "a.bag"), "a.bag: read-only file system"),
        (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "x.py"), "too many open files. Fix: "),
        (ConnectionResetError(), "connectionreseterror"),
    ],
)
def test_what_the_system_refuses_is_one_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    error: OSError,
    line: str,
) -> None:
    def refused(options: object) -> int:
        raise error

    monkeypatch.setattr(topics, "topics", refused)
    before = signal.getsignal(signal.SIGTERM)
    assert main(["topics"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"groundlink: {line}")
    assert said.count("\n") == 1
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("limit", "value", "words", "line"),
    [
        ("RLIMIT_FSIZE", 100, "secure indoor_lab new/folder", "cannot write new/folder: file too"),
        ("RLIMIT_NOFILE", 16, "up indoor_lab --no-ros --listen tcp/127.0.0.1:0", "ulimit -n"),
    ],
)
def test_a_limit_of_the_system_is_one_line(
    tmp_path: Path, limit: str, value: int, words: str, line: str
) -> None:
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, limit, str(value), *words.split()],
        cwd=tmp_path,
        # Python does not notice that it writes a part of a compiled module only.
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert line in done.stdout + done.stderr
    assert "Traceback" not in done.stdout + done.stderr
    assert not [file for file in tmp_path.rglob("*") if file.is_file() or file.name == "folder"]


def test_a_reader_that_has_seen_enough_is_no_mistake() -> None:
    command = f"{sys.executable} -m groundlink schema scenario | head -1"
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert done.stdout == "{\n"
    assert done.stderr == ""


def test_a_file_gets_its_name_when_it_is_complete(tmp_path: Path) -> None:
    out = tmp_path / "a.txt"
    out.write_text("old", encoding="utf-8")
    with suppress(ZeroDivisionError), write_atomically(out) as part:
        part.write_text("half", encoding="utf-8")
        raise ZeroDivisionError
    assert out.read_text(encoding="utf-8") == "old"
    with write_atomically(out) as part:
        part.write_text("new", encoding="utf-8")
        assert out.read_text(encoding="utf-8") == "old"
    assert out.read_text(encoding="utf-8") == "new"
    with pytest.raises(UserError, match=r"cannot write .*none.a: no such file or directory"):
        with write_atomically(tmp_path / "none" / "a") as part:
            part.write_text("x", encoding="utf-8")
    assert list(tmp_path.iterdir()) == [out]


def test_a_folder_gets_its_name_when_it_is_complete(tmp_path: Path) -> None:
    for fails in (True, False):
        try:
            with write_atomically(tmp_path / "out") as part:
                part.mkdir()
                (part / "a").write_text("a", encoding="utf-8")
                assert not fails
        except AssertionError:
            assert not list(tmp_path.iterdir())
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["a"]


def test_without_arguments_it_greets_with_commands_that_exist(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    shown = [line.split("  ")[1].split()[1:] for line in lines if line.startswith("  groundlink ")]
    assert len(shown) == 5
    parser = commands.parser()
    for words in shown:
        assert parser.parse_args(words).command is not parser.get_default("command")
    assert max(map(len, lines)) <= 80
