# SPDX-License-Identifier: Apache-2.0
"""A session that hears nothing of its router is given up; its process starts again by itself."""

import subprocess
import sys
from pathlib import Path

import pytest

from groundlink.bus.core_topics import ROUTER_KEY
from groundlink.bus.session import Bus
from groundlink.core.errors import DeafSession
from groundlink.process.joining import DEAF_SECONDS, WATCHED_SECONDS, RouterCheck

PROGRAM = """
import os, sys
from pathlib import Path
from groundlink.core.errors import DeafSession
from groundlink.process.runner import run

def main(arguments, stop):
    file = Path(arguments[0])
    with file.open("a") as starts:
        starts.write(f"{os.getpid()} {arguments}\\n")
    if len(file.read_text().splitlines()) == 1:
        raise DeafSession("deaf")

run("test", main)
"""


def test_the_router_is_asked_at_the_start_until_it_answers() -> None:
    check = RouterCheck()
    assert check.is_due(0, 10.0)
    check.take(10.0, is_answered=False)
    assert check.is_due(0, 11.0)
    check.take(11.0, is_answered=True)
    assert not check.is_due(0, 12.0)


def test_a_router_that_never_answers_is_not_asked_forever() -> None:
    check = RouterCheck()
    for now in (10.0, 12.0, 10.0 + WATCHED_SECONDS - 1):
        assert check.is_due(0, now)
        check.take(now, is_answered=False)
    assert not check.is_due(0, 10.0 + WATCHED_SECONDS)


def known() -> RouterCheck:
    """Return the check of a session whose router has answered at 10 s."""
    check = RouterCheck()
    assert check.is_due(0, 10.0)
    check.take(10.0, is_answered=True)
    return check


def test_after_a_reconnection_lasting_silence_gives_the_session_up() -> None:
    check = known()
    begin = 30.0 + WATCHED_SECONDS - 1
    assert check.is_due(1, 30.0)
    assert check.is_due(1, begin)
    check.take(begin, is_answered=False)
    assert check.is_due(1, begin + DEAF_SECONDS)
    check.take(begin + DEAF_SECONDS, is_answered=False)
    with pytest.raises(DeafSession):
        check.take(begin + DEAF_SECONDS + 1, is_answered=False)


def test_an_answer_or_another_connection_starts_the_count_again() -> None:
    check = known()
    assert check.is_due(1, 30.0)
    check.take(30.0, is_answered=False)
    check.take(31.0, is_answered=True)
    check.take(32.0, is_answered=False)
    check.take(32.0 + DEAF_SECONDS, is_answered=False)
    assert check.is_due(2, 50.0)
    check.take(50.0, is_answered=False)
    check.take(50.0 + DEAF_SECONDS, is_answered=False)


def test_a_session_sees_its_router(endpoint: str) -> None:
    with Bus(connect=endpoint) as bus:
        assert bus.present(ROUTER_KEY, seconds=5) == {ROUTER_KEY}


def test_the_same_process_starts_again(tmp_path: Path) -> None:
    file = tmp_path / "starts"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(file)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "test: deaf\n")
    first, second = file.read_text().splitlines()
    assert first == second
