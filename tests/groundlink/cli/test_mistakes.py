# SPDX-License-Identifier: Apache-2.0
"""Mistakes at the command line that need no run: one line on stderr, and the exit code."""

import time
from pathlib import Path

import pytest
from rich.console import Console

from groundlink.__main__ import main
from groundlink.cli.run.supervised import SupervisedRun, exit_code
from groundlink.loader.scenario_files import SHIPPED
from groundlink.monitor.supervisor import Supervisor

DAMAGED = b"groundlink journal 1 " + 64 * b"0" + b"\nnothing"


def line(capsys: pytest.CaptureFixture[str], *words: str, code: int = 2) -> str:
    """Return the one line with which a command ends."""
    assert main(words) == code
    out, error = capsys.readouterr()
    assert out == ""
    assert error.count("\n") == 1, error
    return error


def on_gpu(folder: Path) -> Path:
    """Write a scenario whose camera is on another host."""
    text = (SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    file = folder / "spread.yaml"
    file.write_text(text.replace("name: camera,", "name: camera, host: gpu,"), encoding="utf-8")
    return file


@pytest.mark.parametrize("command", [["compose"], ["secure", "--name", "sim.example"]])
def test_another_host_needs_the_router_of_the_main_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    words = [
        *command,
        str(on_gpu(tmp_path)),
        *([str(tmp_path / "out")] if command[0] == "secure" else []),
    ]
    assert "--host gpu: expected --router ENDPOINT" in line(capsys, *words, "--host", "gpu")
    assert "no sensor has `host: gpo`; did you mean `gpu`?" in line(capsys, *words, "--host", "gpo")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("sensors show imu", "`imu`: a kind of sensor; expected the name of a data sheet: imu_"),
        ("sensors show encoders", "none is shipped for this kind"),
        ("view --remove rover/camera", "--set, --add and --remove apply to a recording. Fix: name"),
        ("sensors show nothing_near", "no file `sensors/nothing_near.yaml`"),
        (
            "link --loss 2 --listen 127.0.0.1:0 --to 127.0.0.1:9",
            "--loss 2: expected `float` <= 1.0",
        ),
        (
            "link --back-delay-ms=-1 --listen h:0 --to h:9",
            "--back-delay-ms -1: expected `float` >=",
        ),
        ("spawn nothing.yaml", "nothing.yaml: no such file"),
        ("spawn bax", "did you mean `box`?"),
        ("drive --route nothing.yaml", "nothing.yaml: no such file"),
        ("drive --route cirle", "did you mean `circle`"),
        ("restore nothing.run", "cannot read nothing.run"),
        ("seek nothing.mcap --at 3", "nothing.mcap: no such file"),
        ("up nothing.mcap --at 3", "nothing.mcap: no such file"),
        ("up nothing.mcap", "a recording. Fix: pass the instant to start at, --at S"),
        ("up yard --at 3", "--at 3: expected a recording, got `yard`. Fix: pass a file that"),
        ("replay nothing.mcap", "nothing.mcap: no such file"),
        ("report nothing.mcap", "nothing.mcap: no such file"),
        ("snapshot indoor_lab rover/camera --out shot.jpg", "--out shot.jpg: expected a folder"),
    ],
)
def test_mistakes_are_reported_before_joining_a_run(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in line(capsys, *words.split())
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("command", "content", "said"),
    [
        ("restore", DAMAGED, "truncated or damaged. Fix: copy or save the run again"),
        ("up", DAMAGED, "truncated or damaged. Fix: copy or save the run again"),
        ("save", b"mine", "file exists. Fix: delete it or choose another name"),
    ],
)
def test_a_file_of_a_run_that_cannot_be_used_is_left_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, content: bytes, said: str
) -> None:
    file = tmp_path / "a.run"
    file.write_bytes(content)
    given = f"save {file}" if command == "save" else file
    assert line(capsys, command, str(file)) == f"groundlink: {given}: {said}\n"
    assert file.read_bytes() == content


@pytest.mark.parametrize("command", ["check", "up"])
def test_unanswerable_topic_gives_one_line(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "lab.yaml"
    lab = (SHIPPED / "indoor_lab.yaml").read_text(encoding="utf-8")
    file.write_text(lab + "\ntime: {answers: {/cmd_vel: /odmo}}\n", encoding="utf-8")
    told = line(capsys, command, str(file))
    assert "`time.answers`: /cmd_vel cannot answer /odmo" in told
    assert "/clock, /imu, " in told


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "not a recording of a run: it ends too early"),
        (b"text", "not a recording of a run: it ends too early"),
        (b"\x89MCAP0\r\n" + b"\0" * 40 + b"\x89MCAP0\r\n", "groundlink record"),
        (b"x" * 1000, "it does not begin or end as MCAP files do"),
        (b"\x89MCAP0\r\n", "not a recording of a run"),
    ],
)
@pytest.mark.parametrize("command", ["replay", "report"])
def test_what_is_no_recording_is_said_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, content: bytes, said: str
) -> None:
    file = tmp_path / "a.mcap"
    file.write_bytes(content)
    told = line(capsys, command, str(file))
    assert said in told
    assert str(file) in told
    assert "(error)" not in told


@pytest.mark.parametrize("code", [2, 3])
def test_a_command_ends_with_the_code_of_the_process_that_ended_it(
    capsys: pytest.CaptureFixture[str], code: int
) -> None:
    said: list[str] = []
    words = ["-c", f"import sys; sys.exit({code})"]
    supervisor = Supervisor({"one": words}, lambda name, text: said.append(text))
    supervisor.start()
    try:
        while (failed := supervisor.poll()) is None:
            time.sleep(0.01)
    finally:
        supervisor.stop()
    assert exit_code(supervisor.children[failed]) == code
    assert capsys.readouterr().err == "groundlink: one failed; see its line above\n"


def test_a_line_of_a_process_has_its_name_once(capsys: pytest.CaptureFixture[str]) -> None:
    run = SupervisedRun({"gateway": []}, "run", "tcp/127.0.0.1:0", Console(width=80))
    for text in ("gateway: cannot bind", "cannot bind"):
        run._log("gateway", text)
    assert capsys.readouterr().out == "gateway: cannot bind\n" * 2


LOOP = """
name: loop
world: lab
time: {mode: fast, lockstep: ros, clock_rate_hz: 50, answers: {/cmd_vel: /clock}}
vehicles:
  - {name: rover, model: rover}
"""


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--ros loop.yaml", "--ros: no command. Fix: pass `--ros SCENARIO -- COMMAND...`"),
        ("--ros loop.yaml --limit 0 -- true", "--limit 0: expected more than 0 s"),
        ("--ros loop.yaml --duration nan -- true", "--duration nan: expected more than 0 s"),
        ("--ros indoor_lab -- true", "indoor_lab: `time.lockstep` is not `ros`"),
        ("--ros wrong.yaml -- true", "wrong.yaml: `time.answers`: /cmd_vel cannot answer /nothing"),
    ],
)
def test_verify_of_a_stack_says_what_it_lacks(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: str,
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("loop.yaml").write_text(LOOP, encoding="utf-8")
    Path("wrong.yaml").write_text(LOOP.replace("vel: /clock", "vel: /nothing"), encoding="utf-8")
    assert said in line(capsys, "verify", *words.split())
