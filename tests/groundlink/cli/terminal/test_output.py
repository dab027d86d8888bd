# SPDX-License-Identifier: Apache-2.0
"""What commands print: plain text without a terminal, JSON where a script asks for it."""

import json
import os
import pty
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from groundlink.__main__ import main
from groundlink.cli.terminal import output, progress
from groundlink.cli.terminal.tables import Column, FittingTable
from groundlink.loader.scenario_files import SHIPPED

ESCAPE = "\x1b"
COLOR = "\x1b[33m"
"""Yellow, as ECMA-48 SGR."""

LISTS = ("check indoor_lab", "sensors", "sensors show vlp16", "topics", "explain lidar.dropout")


@contextmanager
def terminal(monkeypatch: pytest.MonkeyPatch, *names: str) -> Iterator[Callable[[], str]]:
    """Replace standard streams by a terminal; yield a function that returns what it received."""
    master, slave = pty.openpty()
    received = []

    def read() -> None:
        try:
            while data := os.read(master, 65536):
                received.append(data)
        except OSError:  # the other end was closed
            pass

    reader = threading.Thread(target=read)
    reader.start()

    def end() -> str:
        stream.close()
        reader.join()
        os.close(master)
        return b"".join(received).decode()

    with open(slave, "w", encoding="utf-8") as stream, monkeypatch.context() as patch:
        patch.delenv("TERM", raising=False)
        for name in names:
            patch.setattr(sys, name, stream)
        yield end


def show_table() -> None:
    table = FittingTable("streams", (Column("topic", "path"), Column("lost", "words")))
    table.add_row("/points", "3 missing", style="yellow")
    output.console().print(table)


def test_colors_are_on_terminals_only_and_not_with_no_color(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    show_table()
    assert ESCAPE not in capsys.readouterr().out
    with terminal(monkeypatch, "stdout") as received:
        monkeypatch.setenv("TERM", "xterm")
        show_table()
        assert COLOR in received()
    with terminal(monkeypatch, "stdout") as received:
        monkeypatch.setenv("NO_COLOR", "1")
        show_table()
        assert COLOR not in received()


@pytest.mark.parametrize("command", LISTS)
def test_lists_are_plain_text_of_80_columns_or_json(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("FORCE_COLOR", "")
    assert main(command.split()) == 0
    text = capsys.readouterr().out
    assert ESCAPE not in text
    text = text.replace(str(SHIPPED), "/shipped")  # as long as where it was installed
    is_list_of_lines = command.startswith(("check", "sensors show"))
    assert is_list_of_lines or max(map(len, text.splitlines())) <= 80
    assert main([*command.split(), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    names = {"check": "vehicles", "topics": "stream", "explain": "path", "sensors": "kind"}
    first = content[0] if isinstance(content, list) else content
    assert names[command.split()[0]] in first


def test_a_bar_is_drawn_on_the_terminal_of_stderr(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "SHOWN_AFTER_SECONDS", 0.0)
    items = range(250)
    assert list(progress.tracked(items, "converting", len(items))) == list(items)
    assert capsys.readouterr() == ("", "")
    with terminal(monkeypatch, "stderr") as received:
        monkeypatch.setenv("TERM", "xterm")
        with progress.progress("converting") as done:
            time.sleep(0.2)
            done(0.5)
        bar = received()
    assert "converting" in bar
    assert "50%" in bar
    assert capsys.readouterr() == ("", "")


def test_short_work_shows_no_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    with terminal(monkeypatch, "stderr") as received:
        with progress.progress("loading") as done:
            done(0.5)
        assert received() == ""
