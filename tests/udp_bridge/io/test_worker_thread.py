# SPDX-License-Identifier: Apache-2.0
import subprocess
import sys

import pytest

from udp_bridge.io.worker_thread import EXIT_STATUS, MOST_FAILURES, ErrorCounter, WorkerThread


def test_a_turn_that_raises_is_counted_logged_once_and_followed_by_the_next(
    caplog: pytest.LogCaptureFixture,
) -> None:
    errors = ErrorCounter()
    turns = iter([RuntimeError("first"), True, RuntimeError("second"), False])

    def turn() -> bool:
        result = next(turns)
        if isinstance(result, Exception):
            raise result
        return result

    thread = WorkerThread("bridge", turn, errors)
    thread.start()
    thread.join()
    assert list(turns) == []
    assert errors.count == 2
    (record,) = caplog.records
    assert record.getMessage() == "bridge failed (errors=1); continuing"
    assert record.exc_info is not None
    assert str(record.exc_info[1]) == "first"


@pytest.mark.parametrize("raised", ["RuntimeError('always')", "SystemExit(0)"])
def test_a_thread_that_cannot_continue_ends_the_process(raised: str) -> None:
    program = f"""
import logging, threading
from udp_bridge.io.worker_thread import ErrorCounter, WorkerThread
logging.getLogger("udp_bridge.io.worker_thread").setLevel(logging.CRITICAL)
def turn():
    raise {raised}
WorkerThread("bridge", turn, ErrorCounter()).start()
threading.Event().wait()
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == EXIT_STATUS
    assert done.stderr == f"bridge: thread ended, ending the process (error={raised})\n"


def test_more_failures_than_an_attack_of_some_datagrams_are_survived() -> None:
    errors = ErrorCounter()
    left = [True] * MOST_FAILURES

    def turn() -> bool:
        if left:
            left.pop()
            raise RuntimeError
        return False

    thread = WorkerThread("bridge", turn, errors)
    thread.start()
    thread.join()
    assert errors.count == MOST_FAILURES
