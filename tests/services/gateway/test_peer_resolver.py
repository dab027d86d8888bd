# SPDX-License-Identifier: Apache-2.0
"""The peer's address, looked up again."""

import threading
from collections.abc import Iterator

import pytest

from groundlink.core.errors import UserError
from groundlink.process.runner import NoSuchHost
from services.gateway.peer_resolver import PeerResolver
from tests.system.rig import wait_for


class Names:
    """A look-up whose answers the test decides."""

    def __init__(self) -> None:
        self.host: str | None = "10.0.0.1"
        self.looked_up = 0
        self.thread = 0
        self.no_host: UserError = NoSuchHost("no host")
        self.hangs = threading.Event()
        self.hangs.set()

    def look_up(self, text: str) -> tuple[str, int]:
        self.thread = threading.get_ident()
        self.hangs.wait()
        self.looked_up += 1
        if self.host is None:
            raise self.no_host
        return self.host, 7511


@pytest.fixture
def names() -> Names:
    return Names()


@pytest.fixture
def stop() -> threading.Event:
    return threading.Event()


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def peer(names: Names) -> Iterator[PeerResolver]:
    peer = PeerResolver("ros2:7511", names.look_up, period_seconds=0.001)
    try:
        yield peer
    finally:
        names.hangs.set()
        peer.close()


def test_another_address_is_taken_and_a_failed_look_up_changes_nothing(
    names: Names, peer: PeerResolver, stop: threading.Event, lines: list[str]
) -> None:
    assert peer.wait(stop, lines.append) == ("10.0.0.1", 7511)
    names.host = None
    before = names.looked_up
    wait_for(lambda: names.looked_up > before + 1, 5, "a look-up")
    assert names.thread != threading.get_ident()
    assert peer.address == ("10.0.0.1", 7511)
    names.host = "10.0.0.2"
    wait_for(lambda: peer.address == ("10.0.0.2", 7511), 5, "the new address")


@pytest.mark.parametrize("hangs", [False, True], ids=["no such host", "no answer"])
def test_unresolved_peer_is_reported_once_and_used_when_resolved(
    hangs: bool, names: Names, stop: threading.Event, lines: list[str]
) -> None:
    names.host = None
    if hangs:
        names.hangs.clear()
    peer = PeerResolver("ros2:7511", names.look_up, period_seconds=0.001)

    def appear() -> None:
        wait_for(lambda: lines, 5, "the line")
        names.host = "10.0.0.3"
        names.hangs.set()

    appears = threading.Thread(target=appear)
    appears.start()
    try:
        assert peer.wait(stop, lines.append) == ("10.0.0.3", 7511)
    finally:
        appears.join()
        peer.close()
    (line,) = lines
    assert "`ros2:7511` has no address yet" in line


def test_ending_does_not_wait_for_name_resolution(
    names: Names, stop: threading.Event, lines: list[str]
) -> None:
    names.host = None
    never = PeerResolver("ros2:7511", names.look_up, period_seconds=0.001)
    stop.set()
    assert never.wait(stop, lines.append) is None
    never.close()


def test_invalid_address_is_a_user_error(
    names: Names, stop: threading.Event, lines: list[str]
) -> None:
    names.host, names.no_host = None, UserError("`ros2`: not an address")
    peer = PeerResolver("ros2", names.look_up)
    with pytest.raises(UserError, match="not an address"):
        peer.wait(stop, lines.append)
    peer.close()
