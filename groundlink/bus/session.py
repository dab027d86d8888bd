# SPDX-License-Identifier: Apache-2.0
"""The bus: messages between the processes of a run, over Zenoh.

Rule: the only importer of `zenoh`. Zenoh's callbacks only hand over to an inbox, which is bounded,
keeps the newest and counts what it drops. Endpoints are explicit, multicast is off; every process
is a client of one router, on one host as on many: peers that find each other by gossip change
routes while data flow, and lost up to 12 states at the start of a run. A session that is not closed
hangs its process, so a `Bus` is a context manager.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from types import TracebackType
from typing import Any

import zenoh
import zenoh.ext

from groundlink.core.errors import UserError
from groundlink.messages.base import M, Message, encode

from . import zenoh_config as zenoh_settings
from .core_topics import Delivery
from .credentials import from_environment
from .inbox import BusInbox

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
"""Where physics listens when it is told neither to listen nor to connect elsewhere."""

REPLIES_KEPT = 4096
"""Of one query: more than the longest answer has, what a sensor has missed of a fast run."""

_CONGESTION_CONTROL = {
    Delivery.NEWEST: zenoh.CongestionControl.DROP,
    Delivery.ALL: zenoh.CongestionControl.BLOCK,
}

HEARTBEAT_SECONDS = 0.5
"""How often a publisher that keeps messages tells what it has."""

_ENDPOINT = re.compile(r"^(tcp|udp|tls|quic|ws)/(\[[0-9a-fA-F:]+\]|[^\s/:]+):(\d{1,5})$")


class BusError(UserError):
    """The bus cannot be joined."""


class Bus:
    """One process's session.

    Parameters
    ----------
    connect
        endpoint of the router to join, such as `tcp/HOST:7447`.
    listen
        endpoint to listen on as the router that others join through.
    onlooker
        never waited for: what this session does not take in time, the router drops.
    name
        of the process, where its credentials have to be its own.
    foreign
        the router is others': the run's credentials are not shown to it, it is not waited for
        longer than Zenoh does by itself, and what is published gets Zenoh's timestamps.

    Raises
    ------
    UserError
        when the endpoints are none, nobody is there, or the credentials are wrong.
    """

    def __init__(
        self,
        *,
        connect: str | None = None,
        listen: str | None = None,
        onlooker: bool = False,
        name: str | None = None,
        foreign: bool = False,
    ) -> None:
        self._declared: list[Any] = []
        self._is_router = listen is not None
        self._links_made = 0
        for endpoint in filter(None, (connect, listen)):
            if not _ENDPOINT.match(endpoint):
                raise BusError(f"`{endpoint}` is no endpoint; expected one like tcp/HOST:7447")
        credentials = None if foreign else from_environment(os.environ)
        if credentials is not None and name is not None:
            credentials.check(name)
        more = credentials.settings() if credentials is not None else {}
        more |= {"timestamping/enabled": True} if foreign else zenoh_settings.PATIENCE
        settings = zenoh_settings.settings_of(connect, listen, onlooker=onlooker) | more
        configuration = zenoh.Config()
        for key, value in settings.items():
            configuration.insert_json5(key, json.dumps(value))
        threads = {"ZENOH_RUNTIME": zenoh_settings.ROUTER_THREADS} if listen else {}
        before = dict(os.environ)
        os.environ.update(threads | before)
        try:
            self._session = zenoh.open(configuration)
        except zenoh.ZError as error:
            raise BusError(_explained(str(error), connect, listen)) from None
        except BaseException as error:
            # Zenoh panics where it may open no more files, by an exception outside of Exception.
            if type(error).__name__ != "PanicException":
                raise
            raise BusError(
                f"Zenoh cannot start here: {error}. Fix: raise the limit of open files, "
                "ulimit -n 1024"
            ) from None
        finally:
            for name in threads.keys() - before:  # no business of the processes that it starts
                del os.environ[name]
        if not self._is_router:
            self._declared.append(
                self._session.info.declare_transport_events_listener(self._on_link)
            )

    def _on_link(self, event: zenoh.TransportEvent) -> None:
        self._links_made += event.kind == zenoh.SampleKind.PUT

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the bus."""
        for declared in self._declared:
            declared.undeclare()
        self._declared.clear()
        self._session.close()  # type: ignore[no-untyped-call]

    def is_linked(self) -> bool:
        """Return whether there is a way to others: this is the router, or has a link to it."""
        return self._is_router or bool(self._session.info.routers_zid())

    def links_made(self) -> int:
        """Return how often this session had to make another link to its router.

        What was published by the one before may never have come.
        """
        return self._links_made

    def publisher(
        self, key: str, delivery: Delivery, *, bulky: bool = False
    ) -> Callable[[Message], bytes]:
        """Return a function that publishes messages under `key` and returns their bytes.

        Parameters
        ----------
        bulky
            take the way of large messages, or of what must not overtake them: it has queues of its
            own, and small ones go first.
        """
        publisher = self._session.declare_publisher(
            key,
            congestion_control=_CONGESTION_CONTROL[delivery],
            priority=zenoh.Priority.DATA_LOW if bulky else zenoh.Priority.DATA,
        )
        self._declared.append(publisher)

        def publish(message: Message) -> bytes:
            payload = encode(message)
            publisher.put(payload)
            return payload

        return publish

    @property
    def identity(self) -> str:
        """Zenoh's name of this session."""
        return str(self._session.zid())

    def publisher_of_bytes(self, key: str, *, kept: int = 0) -> Callable[[bytes, bytes], None]:
        """Return a function that publishes bytes, and what is attached to them, under `key`.

        Parameters
        ----------
        kept
            how many messages are kept for those that subscribe later and ask for them.
        """
        congestion_control = zenoh.CongestionControl.DROP
        publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher
        if kept:
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=congestion_control,
                cache=zenoh.ext.CacheConfig(kept),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=HEARTBEAT_SECONDS, sporadic_heartbeat=None
                ),
                publisher_detection=True,
            )
        else:
            publisher = self._session.declare_publisher(key, congestion_control=congestion_control)
        self._declared.append(publisher)

        def publish(payload: bytes, attachment: bytes) -> None:
            publisher.put(payload, attachment=attachment)

        return publish

    def subscribe_bytes(self, key: str, take: Callable[[bytes], None]) -> None:
        """Call `take` with what arrives under `key`, on a thread of Zenoh's: it must not block."""
        self._declared.append(
            self._session.declare_subscriber(key, lambda sample: take(sample.payload.to_bytes()))
        )

    def subscribe(self, key: str, message_type: type[M], inbox: BusInbox[M]) -> None:
        """Put every message that arrives under `key` into `inbox`."""

        def hand_over(sample: zenoh.Sample) -> None:
            inbox.put(str(sample.key_expr), sample.payload.to_bytes(), message_type)

        self._declared.append(self._session.declare_subscriber(key, hand_over))

    def subscribe_in_order(
        self, key: str, type_of: Callable[[str], type[M] | None], inbox: BusInbox[M]
    ) -> None:
        """Put every message that arrives under a key expression into `inbox` as it came.

        Zenoh serves each subscriber on a thread of its own: among those of several keys, order is
        lost there. What `type_of` has no type for, by its key, is passed over.
        """

        def hand_over(sample: zenoh.Sample) -> None:
            came_on = str(sample.key_expr)
            if (message_type := type_of(came_on)) is not None:
                inbox.put(came_on, sample.payload.to_bytes(), message_type)

        self._declared.append(self._session.declare_subscriber(key, hand_over))

    def serve(self, key: str, answer: Callable[[str], list[bytes]]) -> None:
        """Answer queries for `key`: `answer` gets the query's parameters, its items are replies.

        Replies to one query have keys `key/0`, `key/1`, ... so that none replaces another.
        """
        self.serve_content(key, lambda asked, _: answer(asked))

    def serve_content(self, key: str, answer: Callable[[str, bytes], list[bytes]]) -> None:
        """Answer queries for `key` as `serve` does; `answer` gets what comes with a query, too."""

        def reply(query: zenoh.Query) -> None:
            with query:
                content = query.payload.to_bytes() if query.payload is not None else b""
                for i, item in enumerate(answer(str(query.parameters), content)):
                    query.reply(f"{key}/{i}", item)

        self._declared.append(self._session.declare_queryable(f"{key}/**", reply))

    def ask(
        self, key: str, parameters: str = "", *, seconds: float, content: bytes | None = None
    ) -> dict[str, bytes]:
        """Return all replies that come within `seconds`, by key, in the order of their numbers."""
        selector = f"{key}/**?{parameters}" if parameters else f"{key}/**"
        replies = {}
        # Zenoh's own queue holds 256. Where it is full before the first is taken out, and this
        # session has queryables too, `get` waits for itself for ever.
        room: zenoh.handlers.FifoChannel[zenoh.Reply] = zenoh.handlers.FifoChannel(REPLIES_KEPT)
        for reply in self._session.get(selector, room, timeout=seconds, payload=content):
            if reply.ok is not None:
                replies[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()
        return dict(sorted(replies.items(), key=lambda item: int(item[0].rpartition("/")[2])))

    def announce(self, key: str) -> Callable[[], None]:
        """Show that this process is there, under `key`, for as long as the session lives.

        Returns
        -------
        callable
            takes it back before.
        """
        token = self._session.liveliness().declare_token(key)
        self._declared.append(token)

        def withdraw() -> None:
            self._declared.remove(token)
            token.undeclare()  # type: ignore[no-untyped-call]

        return withdraw

    def present(self, key: str, *, seconds: float) -> set[str]:
        """Return the keys of the processes that are there now, of those that `key` matches."""
        replies = self._session.liveliness().get(key, timeout=seconds)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change(key, there)` for every process that is there, comes or goes."""

        def hand_over(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(key, hand_over, history=True)
        )


def _explained(problem: str, connect: str | None, listen: str | None) -> str:
    """Return what Zenoh's error means to the one who gave the endpoints."""
    if listen and "in use" in problem:
        return f"{listen} is in use; end the other process or choose a port with --listen"
    if listen and "listener" in problem:
        return f"cannot listen on {listen}: {problem.split(': ')[-1][:80]}"
    within = f"{zenoh_settings.CONNECT_SECONDS:.0f} s"
    if connect and connect.startswith("tls/"):
        return (
            f"{connect} was not joined within {within}: nobody is there, or one of the two does "
            "not take the other's certificate (another run's, or expired); see "
            "GROUNDLINK_CREDENTIALS"
        )
    return (
        f"nobody answered at {connect} within {within}; start physics or a router there first, or "
        "correct --connect"
    )
