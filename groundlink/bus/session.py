# SPDX-License-Identifier: Apache-2.0
"""Bus sessions: messages, queries and liveliness between the processes of a run, over Zenoh.

The only module that imports `zenoh`. Zenoh's callbacks only store into an inbox. Endpoints are
explicit and multicast is off. Every process is a client of one router, on one host too: peers that
find each other by gossip change routes while data flows, and lost up to 12 states at the start of a
run. An open session blocks the exit of its process, so a `Bus` is a context manager.
"""

import json
import os
import re
import threading
from collections import deque
from collections.abc import Callable
from typing import Any

import zenoh
import zenoh.ext

from groundlink.core.errors import DeafSession, UserError
from groundlink.messages.base import BusMessage, M, encode, encode_in_pieces

from . import zenoh_config
from .channel import WAKE_SECONDS, BusChannel, PayloadSource
from .core_topics import ROUTER_KEY, Delivery
from .credentials import from_environment
from .inbox import BusInbox
from .local_inbox import LocalInbox, StoredPayloads
from .local_stream import LocalSource, LocalStream

REPLIES_KEPT = 4096
"""Maximum number of replies to one query; the longest answer is the history of a fast run."""

_CONGESTION_CONTROL = {
    Delivery.NEWEST: zenoh.CongestionControl.DROP,
    Delivery.ALL: zenoh.CongestionControl.BLOCK,
}

HEARTBEAT_SECONDS = 0.5
"""Period of the heartbeat of a publisher with a cache."""

_ENDPOINT = re.compile(r"^(tcp|udp|tls|quic|ws)/(\[[0-9a-fA-F:]+\]|[^\s/:]+):(\d{1,5})$")


_LOCAL = "@local"
"""Chunk before the name of a local stream, in the key by which its publisher announces it."""


class BusError(UserError):
    """The bus cannot be joined."""


class Bus:
    """The session of one process.

    Parameters
    ----------
    connect
        endpoint of the router to join, such as `tcp/HOST:7447`.
    listen
        endpoint to listen on, as the router of the run.
    observer
        the router does not wait for this session and drops messages that it is too slow for.
    name
        process name, checked against the credentials.
    foreign
        the router is not part of the run: use no credentials and Zenoh's default queues, and
        publish with Zenoh's timestamps.

    Raises
    ------
    UserError
        if an endpoint is malformed or not reachable, or the credentials are wrong.
    """

    def __init__(
        self,
        *,
        connect: str | None = None,
        listen: str | None = None,
        observer: bool = False,
        name: str | None = None,
        foreign: bool = False,
    ) -> None:
        self._declared: list[Any] = []
        self._local_sources: list[LocalSource] = []
        self._is_router = listen is not None
        self._connections = 0
        # Messages until `flush`. A deque, since other threads publish, too.
        self._held: deque[tuple[zenoh.Publisher, bytes]] | None = None
        for endpoint in filter(None, (connect, listen)):
            if not _ENDPOINT.match(endpoint):
                raise BusError(
                    f"`{endpoint}`: not an endpoint; expected PROTOCOL/HOST:PORT such as "
                    "tcp/HOST:7447"
                )
        credentials = None if foreign else from_environment(os.environ)
        self._is_secured = credentials is not None
        if credentials is not None and name is not None:
            credentials.check(name)
        more = credentials.settings() if credentials is not None else {}
        more |= {"timestamping/enabled": True} if foreign else zenoh_config.SENDER_QUEUE
        settings = zenoh_config.settings_of(connect, listen, observer=observer) | more
        configuration = zenoh.Config()
        for key, value in settings.items():
            configuration.insert_json5(key, json.dumps(value))
        runtime = zenoh_config.ROUTER_THREADS if listen else zenoh_config.CLIENT_THREADS
        threads = {"ZENOH_RUNTIME": runtime}
        before = dict(os.environ)
        os.environ.update(threads | before)
        try:
            self._session = zenoh.open(configuration)
        except zenoh.ZError as error:
            raise BusError(_explained(str(error), connect, listen)) from None
        except BaseException as error:
            # Zenoh panics at the limit of open files, with an exception that is not an Exception.
            if type(error).__name__ != "PanicException":
                raise
            raise BusError(
                f"Zenoh cannot start here: {error}. Fix: raise the limit of open files, "
                "ulimit -n 1024"
            ) from None
        finally:
            for name in threads.keys() - before:  # child processes must not inherit them
                del os.environ[name]
        if self._is_router:
            self.announce(ROUTER_KEY)
        else:
            self._declared.append(
                self._session.info.declare_transport_events_listener(self._on_connection)
            )

    def _on_connection(self, event: zenoh.TransportEvent) -> None:
        self._connections += event.kind == zenoh.SampleKind.PUT
        if event.kind == zenoh.SampleKind.DELETE:
            for source in self._local_sources:
                source.cut_off()

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not DeafSession:  # its router would not answer the farewell, for 10 s
            self.close()

    def close(self) -> None:
        """Leave the bus."""
        self.flush()
        for declared in reversed(self._declared):  # a reader before what it reads
            declared.undeclare()
        self._declared.clear()
        self._session.close()  # type: ignore[no-untyped-call]

    def is_connected(self) -> bool:
        """Return whether this session is a router or connected to one."""
        return self._is_router or bool(self._session.info.routers_zid())

    def reconnects(self) -> int:
        """Return how often this session reconnected to its router.

        Messages published before a reconnection may be lost.
        """
        return self._connections

    def publisher(
        self, key: str, delivery: Delivery, *, bulky: bool = False, local: bool = False
    ) -> Callable[[BusMessage], bytes]:
        """Return a function that publishes messages under `key` and returns their bytes.

        Parameters
        ----------
        local
            offer the messages, frequent and small ones, to processes of this machine without the
            router as well. They may then overtake other messages of this session.
        bulky
            use the low-priority queues of large messages. Also for messages that must not overtake
            those.
        """
        publisher = self._declare_publisher(key, delivery, bulky=bulky)
        if local and not self._is_secured:
            stream = self._local_stream(key)

            def publish_locally(message: BusMessage) -> bytes:
                payload = encode(message)
                stream.send(payload)  # first: see `LocalSource`
                publisher.put(payload)
                return payload

            return publish_locally

        def publish(message: BusMessage) -> bytes:
            payload = encode(message)
            if self._held is None:
                publisher.put(payload)
            else:
                self._held.append((publisher, payload))
            return payload

        return publish

    def hold(self) -> None:
        """From now on keep messages until `flush`, but not those of local streams.

        For processes that nobody waits for message by message. Each message wakes a thread here, in
        the router and at the receiver; several at once wake each of them once.
        """
        self._held = deque()

    def flush(self) -> None:
        """Publish the messages that were kept, in order; for one thread."""
        while self._held:
            publisher, payload = self._held.popleft()
            publisher.put(payload)

    def _declare_publisher(self, key: str, delivery: Delivery, *, bulky: bool) -> zenoh.Publisher:
        publisher = self._session.declare_publisher(
            key,
            congestion_control=_CONGESTION_CONTROL[delivery],
            priority=zenoh.Priority.DATA_LOW if bulky else zenoh.Priority.DATA,
        )
        self._declared.append(publisher)
        return publisher

    def _local_stream(self, key: str) -> LocalStream:
        """Return a local stream whose socket has been announced."""
        stream = LocalStream()
        self._declared.append(stream)
        self.announce(f"{key}/{_LOCAL}/{stream.name}")
        return stream

    def reading_publisher(
        self, key: str, delivery: Delivery, *, bulky: bool = False, local: bool = False
    ) -> Callable[[BusMessage], object]:
        """Return a function that publishes messages of any size under `key`.

        Parameters
        ----------
        local
            as for `publisher`. A message is passed to the router only if somebody has subscribed to
            it there.
        """
        if not local or self._is_secured:
            return self.publisher(key, delivery, bulky=bulky)
        publisher = self._declare_publisher(key, delivery, bulky=bulky)
        stream = self._local_stream(key)

        def publish(message: BusMessage) -> None:
            pieces = encode_in_pieces(message)
            stream.send(*pieces)  # first: see `LocalSource`
            if publisher.matching_status.matching:  # type: ignore[attr-defined]
                publisher.put(b"".join(pieces))

        return publish

    @property
    def identity(self) -> str:
        """Zenoh id of this session."""
        return str(self._session.zid())

    def publisher_of_bytes(self, key: str, *, cached: int = 0) -> Callable[[bytes, bytes], None]:
        """Return a function that publishes a payload with an attachment under `key`.

        Parameters
        ----------
        cached
            size of the cache for subscribers that join later.
        """
        congestion_control = zenoh.CongestionControl.DROP
        publisher: zenoh.Publisher | zenoh.ext.AdvancedPublisher
        if cached:
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=congestion_control,
                cache=zenoh.ext.CacheConfig(cached),
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
        """Call `take` with each payload under `key`, on a thread of Zenoh: it must not block."""
        self._declared.append(
            self._session.declare_subscriber(key, lambda sample: take(sample.payload.to_bytes()))
        )

    def subscribe(self, key: str, message_type: type[M], inbox: BusInbox[M]) -> None:
        """Put messages under `key` into `inbox`."""

        def hand_over(sample: zenoh.Sample) -> None:
            inbox.put(str(sample.key_expr), sample.payload.to_bytes(), message_type)

        self._declared.append(self._session.declare_subscriber(key, hand_over))

    def channel(
        self, key: str, message_type: type[M], *, depth: int, local: bool = False
    ) -> BusChannel[M]:
        """Return a channel of the messages under `key`, of which `depth` may wait.

        With `local`, take them without the router from a publisher on this machine.
        """
        return BusChannel(self._source(key, depth, local=local), message_type, depth=depth)

    def _source(self, key: str, depth: int, *, local: bool) -> PayloadSource:
        """Return the payloads under a key; of a secured bus, all by its router."""

        def declare() -> PayloadSource:
            return _RoutedSource(self._session, key, depth)

        if local and not self._is_secured:
            return self._local_source(key, declare)
        source = declare()
        self._declared.append(source)
        return source

    def _local_source(self, key: str, declare: Callable[[], PayloadSource]) -> LocalSource:
        """Return the payloads under a key, of a local stream once one is found."""
        source = LocalSource(declare)
        prefix = f"{key}/{_LOCAL}/"

        def found(token: str, is_there: bool) -> None:
            if is_there:
                source.found(token.removeprefix(prefix))

        self._local_sources.append(source)
        self.watch(f"{prefix}*", found)
        self._declared.append(source)
        return source

    def local_inbox(self, *, depth: int) -> LocalInbox[Any]:
        """Return an inbox for `subscribe_local`."""
        inbox: LocalInbox[Any] = LocalInbox(depth=depth)
        self._declared.append(inbox)
        return inbox

    def subscribe_local(self, key: str, message_type: type[M], inbox: LocalInbox[M]) -> None:
        """Put messages under `key` into `inbox`; without the router from this machine.

        Call it in the thread that reads the inbox.
        """
        if self._is_secured:
            self.subscribe(key, message_type, inbox)
            return

        def subscribe(store: Callable[[bytes], None]) -> zenoh.Subscriber[None]:
            return self._session.declare_subscriber(
                key, lambda sample: store(sample.payload.to_bytes())
            )

        def declare() -> PayloadSource:
            return StoredPayloads(subscribe, inbox.wake, depth=inbox.depth)

        inbox.add(key, message_type, self._local_source(key, declare))

    def subscribe_in_order(
        self, key: str, type_of: Callable[[str], type[M] | None], inbox: BusInbox[M]
    ) -> None:
        """Put messages under a key expression into `inbox`, in order of arrival across keys.

        Zenoh serves each subscriber on its own thread, so separate subscribers have no common
        order. Messages for whose key `type_of` returns None are skipped.
        """

        def hand_over(sample: zenoh.Sample) -> None:
            own_key = str(sample.key_expr)
            if (message_type := type_of(own_key)) is not None:
                inbox.put(own_key, sample.payload.to_bytes(), message_type)

        self._declared.append(self._session.declare_subscriber(key, hand_over))

    def serve(self, key: str, answer: Callable[[str], list[bytes]]) -> None:
        """Answer queries for `key`: `answer` gets the parameters and returns the replies.

        Replies to one query have the keys `key/0`, `key/1`, ... because replies with equal keys
        replace each other.
        """
        self.serve_content(key, lambda parameters, _: answer(parameters))

    def serve_content(self, key: str, answer: Callable[[str, bytes], list[bytes]]) -> None:
        """Answer queries for `key` like `serve`; `answer` gets the payload of the query too."""

        def reply(query: zenoh.Query) -> None:
            with query:
                content = query.payload.to_bytes() if query.payload is not None else b""
                for i, item in enumerate(answer(str(query.parameters), content)):
                    query.reply(f"{key}/{i}", item)

        self._declared.append(self._session.declare_queryable(f"{key}/**", reply))

    def query(
        self, key: str, parameters: str = "", *, seconds: float, content: bytes | None = None
    ) -> dict[str, bytes]:
        """Return the replies that arrive within `seconds`, by key, ordered by number."""
        selector = f"{key}/**?{parameters}" if parameters else f"{key}/**"
        replies = {}
        # Zenoh's default queue holds 256 replies. If it is full before the first is read, and this
        # session has queryables, `get` deadlocks.
        room: zenoh.handlers.FifoChannel[zenoh.Reply] = zenoh.handlers.FifoChannel(REPLIES_KEPT)
        for reply in self._session.get(selector, room, timeout=seconds, payload=content):
            if reply.ok is not None:
                replies[str(reply.ok.key_expr)] = reply.ok.payload.to_bytes()
        return dict(sorted(replies.items(), key=lambda item: int(item[0].rpartition("/")[2])))

    def announce(self, key: str) -> Callable[[], None]:
        """Declare a liveliness token under `key`; return a function that withdraws it early."""
        token = self._session.liveliness().declare_token(key)
        self._declared.append(token)

        def withdraw() -> None:
            self._declared.remove(token)
            token.undeclare()  # type: ignore[no-untyped-call]

        return withdraw

    def present(self, key: str, *, seconds: float) -> set[str]:
        """Return the keys of current liveliness tokens that match `key`."""
        replies = self._session.liveliness().get(key, timeout=seconds)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    def watch(self, key: str, on_change: Callable[[str, bool], None]) -> None:
        """Call `on_change(key, present)` for each current token, and when one appears or goes."""

        def hand_over(sample: zenoh.Sample) -> None:
            on_change(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(key, hand_over, history=True)
        )


class _RoutedSource:
    """Payloads under a key that come by the router (a `PayloadSource`)."""

    def __init__(self, session: zenoh.Session, key: str, depth: int) -> None:
        self._session, self._key = session, key
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(depth)
        self._subscriber = session.declare_subscriber(key, ring)
        self._ended = threading.Event()
        # Channels of Zenoh have no timeout, so this session sends itself empty payloads.
        self._timer = threading.Thread(target=self._wake, daemon=True)
        self._timer.start()

    def _wake(self) -> None:
        while not self._ended.wait(WAKE_SECONDS):
            self._session.put(self._key, b"", allowed_destination=zenoh.Locality.SESSION_LOCAL)

    def receive(self) -> bytes:
        return self._subscriber.recv().payload.to_bytes()

    def poll(self) -> bytes | None:
        sample = self._subscriber.try_recv()
        return None if sample is None else sample.payload.to_bytes()

    def undeclare(self) -> None:
        self._ended.set()
        self._timer.join()
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]


def _explained(problem: str, connect: str | None, listen: str | None) -> str:
    """Return an error line for a Zenoh error, in terms of the endpoints."""
    if listen and "in use" in problem:
        return f"{listen}: the address is in use. Fix: end the other process or pass --listen"
    if listen and "listener" in problem:
        return f"{listen}: cannot listen: {problem.split(': ')[-1][:80]}"
    within = f"{zenoh_config.CONNECT_SECONDS:.0f} s"
    if connect and connect.startswith("tls/"):
        return (
            f"{connect}: no connection within {within}: no router listens there, or one side "
            "rejected the other's certificate (of another run, or expired). Fix: check "
            "GROUNDLINK_CREDENTIALS"
        )
    return (
        f"{connect}: no answer within {within}. Fix: start physics or a router there, or correct "
        "--connect"
    )
