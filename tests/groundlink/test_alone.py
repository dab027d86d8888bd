# SPDX-License-Identifier: Apache-2.0
"""Of processes of one name that start at the same instant, over real Zenoh, one goes on."""

from __future__ import annotations

import os
import socket
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from groundlink.alone import alone, claims_key
from groundlink.bus import Bus
from groundlink.cli.running import free_endpoint
from groundlink.errors import UserError
from groundlink.process import Heartbeat

RUN, NAME = "lab", "gateway"
AT_ONCE = 3


@pytest.fixture
def endpoint() -> Iterator[str]:
    endpoint = free_endpoint()
    with Bus(listen=endpoint):
        yield endpoint


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
                alone(bus, RUN, NAME)
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
    where = f"`{NAME}` of run `{RUN}` is there already, on {socket.gethostname()} "
    assert [text.startswith(where) for text in said] == [True] * (AT_ONCE - 1) + [False]
    assert said[-1] == "went on"


def test_a_name_is_free_again_when_its_process_has_ended(endpoint: str) -> None:
    for _ in range(2):
        with Bus(connect=endpoint) as bus:
            alone(bus, RUN, NAME)
            bus.announce(f"groundlink/{RUN}/health/{NAME}")


def test_who_comes_while_another_one_is_starting_waits_to_see_who_it_is(endpoint: str) -> None:
    over = threading.Event()
    with Bus(connect=endpoint) as first, Bus(connect=endpoint) as second:
        # It has claimed the name with the highest number, and has not told how it is.
        first.announce(f"{claims_key(RUN, NAME)}/{'9' * 19}")
        starts = threading.Timer(1.0, live, (first, over))
        starts.start()
        with pytest.raises(UserError, match=f"is there already, on .* .process {os.getpid()}."):
            alone(second, RUN, NAME)
        over.set()
        starts.join()
