# SPDX-License-Identifier: Apache-2.0
"""Of processes of one name that start at the same instant, over real Zenoh, one goes on."""

import os
import socket
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from groundlink.bus.session import Bus
from groundlink.core.errors import UserError
from groundlink.process.joining import Heartbeat
from groundlink.process.name_claim import YIELD_SECONDS, NameClaim, claim_name, claims_key
from tests.system.rig import wait_for

RUN, NAME = "lab", "gateway"
AT_ONCE = 3


def live(bus: Bus, over: threading.Event) -> None:
    """Beat, as a process does that goes on."""
    heartbeat = Heartbeat(bus, RUN, NAME)
    while not over.wait(0.1):
        heartbeat.beat(0, {})


def test_of_several_that_start_at_once_one_goes_on(endpoint: str) -> None:
    together, over = threading.Barrier(AT_ONCE), threading.Event()
    ends = threading.Semaphore(0)

    def start(_: int) -> str:
        with Bus(connect=endpoint) as bus:
            together.wait(20)
            try:
                claim_name(bus, RUN, NAME)
            except UserError as error:
                ends.release()
                return str(error)
            live(bus, over)
            return "went on"

    with ThreadPoolExecutor(AT_ONCE) as pool:
        ended = pool.map(start, range(AT_ONCE))
        try:
            for _ in range(AT_ONCE - 1):
                assert ends.acquire(timeout=30), "more than one goes on"
        finally:
            over.set()
        said = sorted(ended)
    where = f"run `{RUN}`: another `{NAME}` runs on {socket.gethostname()} "
    assert sorted(text.startswith(where) for text in said) == [False] + [True] * (AT_ONCE - 1)
    assert "went on" in said


def test_a_name_is_free_again_when_its_process_has_ended(endpoint: str) -> None:
    for _ in range(2):
        with Bus(connect=endpoint) as bus:
            claim_name(bus, RUN, NAME)
            bus.announce(f"groundlink/{RUN}/health/{NAME}")


def test_who_comes_while_another_one_is_starting_waits_to_see_who_it_is(endpoint: str) -> None:
    over = threading.Event()
    with Bus(connect=endpoint) as first, Bus(connect=endpoint) as second:
        # It has claimed the name with the highest number, and has not told how it is.
        first.announce(f"{claims_key(RUN, NAME)}/{'9' * 19}")
        starts = threading.Timer(1.0, live, (first, over))
        starts.start()
        with pytest.raises(UserError, match=rf"another `{NAME}` runs on .* \(pid {os.getpid()}\)"):
            claim_name(second, RUN, NAME)
        over.set()
        starts.join()


class Cut:
    """A bus that comes back after it was cut off, on which the test says who else is there."""

    def __init__(self) -> None:
        self.there: set[str] = set()

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        assert key == f"{claims_key(RUN, NAME)}/*"
        self._on_change = on_change

    def present(self, key: str, *, seconds: float) -> set[str]:
        return self.there & {key}

    def comes(self, number: int, *, there: bool = True, told: bool = True) -> None:
        key = f"{claims_key(RUN, NAME)}/{number}"
        self.there = self.there | {key} if there else self.there - {key}
        if told:
            self._on_change(key, there)


def claim(bus: Any) -> NameClaim:
    return NameClaim(bus, RUN, NAME, f"{claims_key(RUN, NAME)}/5")


def test_who_was_cut_off_ends_when_a_later_one_has_taken_its_place() -> None:
    bus = Cut()
    own = claim(bus)
    bus.comes(7)
    own.check(time.monotonic())
    with pytest.raises(UserError, match=f"run `{RUN}`: another `{NAME}` was started while"):
        own.check(time.monotonic() + YIELD_SECONDS)
    own.check(time.monotonic() + 2 * YIELD_SECONDS)


def test_a_look_that_nobody_answers_in_time_is_repeated() -> None:
    bus = Cut()
    own = claim(bus)
    bus.comes(7)
    there, bus.there = bus.there, set()
    own.check(time.monotonic() + 2 * YIELD_SECONDS)
    bus.there = there
    with pytest.raises(UserError, match="ending in favor of the newer one"):
        own.check(time.monotonic() + 2 * YIELD_SECONDS)


def test_who_goes_on_is_not_stopped_by_one_that_comes_back_or_looks_or_has_gone() -> None:
    bus = Cut()
    own = claim(bus)
    for number in (3, 5, 7, 8):
        bus.comes(number)
    bus.comes(7, there=False)
    bus.comes(8, there=False, told=False)
    own.check(time.monotonic() + 2 * YIELD_SECONDS)


def test_two_that_run_see_each_other(endpoint: str) -> None:
    with Bus(connect=endpoint) as first, Bus(connect=endpoint) as second:
        earlier = claim_name(first, RUN, NAME)
        later = f"{claims_key(RUN, NAME)}/{time.time_ns():019}0000000000"
        second.announce(later)
        with pytest.raises(UserError, match="ending in favor of the newer one"):
            wait_for(lambda: earlier.check(time.monotonic() + YIELD_SECONDS), 10, "it sees it")
