# SPDX-License-Identifier: Apache-2.0
"""The peer's address, looked up again."""

from __future__ import annotations

import threading

import pytest

from groundlink.errors import UserError
from services.gateway.whereabouts import Whereabouts
from tests.system.rig import wait_for


class Names:
    """A look-up whose answers the test decides."""

    def __init__(self) -> None:
        self.host: str | None = "10.0.0.1"
        self.threads: set[int] = set()

    def look_up(self, text: str) -> tuple[str, int]:
        self.threads.add(threading.get_ident())
        if self.host is None:
            raise UserError("no host")
        return self.host, 7511


def test_another_address_is_taken_and_a_failed_look_up_changes_nothing() -> None:
    names = Names()
    peer = Whereabouts("ros2:7511", names.look_up, period_seconds=0.001)
    try:
        assert peer.address == ("10.0.0.1", 7511)
        names.host = None
        wait_for(lambda: len(names.threads) == 2, 5, "a look-up on a thread of its own")
        assert peer.address == ("10.0.0.1", 7511)
        names.host = "10.0.0.2"
        wait_for(lambda: peer.address == ("10.0.0.2", 7511), 5, "the new address")
    finally:
        peer.close()


def test_a_peer_without_any_address_is_the_users_mistake() -> None:
    names = Names()
    names.host = None
    with pytest.raises(UserError, match="no host"):
        Whereabouts("ros2:7511", names.look_up)
