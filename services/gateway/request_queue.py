# SPDX-License-Identifier: Apache-2.0
"""Requests from ROS, executed one after the other, each once.

Physics may take seconds to answer, so a thread of its own waits for it. A request that arrives
again was not answered yet, or its reply was lost: it is answered again and not executed again.
Each kind of request has a queue, so that a long one delays only its own kind.
"""

import queue
import threading
from collections.abc import Callable, Sized
from typing import Generic, TypeVar

from udp_bridge.wire.run_commands import RunCommand, RunCommandReply
from udp_bridge.wire.world_queries import WorldQuery, WorldReply

REPLIES_KEPT = 256
"""Replies that can be sent again; a request is repeated for some seconds."""

REQUESTS_WAITING = 64
"""Further requests are dropped; the peer repeats them."""

BACKLOG_CHECKS = 500
"""Most checks, one each millisecond, whether the messages that physics published before its answer
were sent. The reply follows them."""

END_SECONDS = 0.5
"""How long `close` waits for the present request."""

RequestT = TypeVar("RequestT", RunCommand, WorldQuery)
ReplyT = TypeVar("ReplyT", RunCommandReply, WorldReply)


class RequestQueue(Generic[RequestT, ReplyT]):
    """Requests that were received, and their replies.

    Parameters
    ----------
    execute
        executes a request and returns the reply.
    backlog
        messages of the bus that wait to be sent.
    """

    def __init__(self, execute: Callable[[RequestT], ReplyT], *, backlog: Sized) -> None:
        self._execute: Callable[[RequestT], ReplyT] = execute
        self._backlog = backlog
        self._send: Callable[[ReplyT], object] | None = None
        self._is_over = threading.Event()
        self._waiting: queue.SimpleQueue[RequestT | None] = queue.SimpleQueue()
        self._replies: dict[int, ReplyT | None] = {}
        """By the request's number; None while it is executed."""

        self._thread = threading.Thread(target=self._run, name="requests", daemon=True)
        self._thread.start()

    def reply_with(self, send: Callable[[ReplyT], object]) -> None:
        """Set the function that sends replies to the peer."""
        self._send = send

    def put(self, request: RequestT) -> None:
        """Take a request of the peer; called on the link's receive thread, never blocks."""
        if request.number in self._replies:
            reply = self._replies[request.number]
            if reply is not None and self._send is not None:
                self._send(reply)
        elif self._waiting.qsize() < REQUESTS_WAITING:
            self._replies[request.number] = None
            while len(self._replies) > REPLIES_KEPT:
                del self._replies[next(iter(self._replies))]
            self._waiting.put(request)

    def close(self) -> None:
        """Drop requests that wait, and end the thread after the present one if that ends soon."""
        self._is_over.set()
        self._waiting.put(None)
        self._thread.join(END_SECONDS)

    def _run(self) -> None:
        while (request := self._waiting.get()) is not None and not self._is_over.is_set():
            reply = self._execute(request)
            self._send_backlog()
            self._replies[request.number] = reply
            if self._send is not None:
                self._send(reply)

    def _send_backlog(self) -> None:
        checks = 0
        while len(self._backlog) and checks < BACKLOG_CHECKS and not self._is_over.wait(0.001):
            checks += 1
