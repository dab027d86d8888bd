# SPDX-License-Identifier: Apache-2.0
"""Messages in, messages out, over a socket of its own: the library's only threads and clocks.

One thread receives, one sends what has to wait. Nothing that the network does raises: it is
counted. What is decided is decided in `sending` and `receiving`, which know no time of day.
"""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Any, Dict, List, Optional, Tuple, Type

from udp_bridge.receiver.delivery_log import Counters
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.receiver.limits import Limits
from udp_bridge.sender.accounts import Account
from udp_bridge.sender.pending import WaitingTable
from udp_bridge.sender.repair import Mode, RepairTable, check_table
from udp_bridge.wire.control import TopicReport
from udp_bridge.wire.fragments import DatagramSize, TooLarge, check_datagram_size
from udp_bridge.wire.header import BadMessage, Buffer
from udp_bridge.wire.message import Address, Message

from .address_guard import guarded
from .receive_thread import Listening, OnMessage
from .send_thread import AT_ONCE_BYTES, Departures
from .udp_socket import DatagramSocket, UdpSocket
from .worker_thread import ErrorCounter, WorkerThread

DEFAULT_RECEIVE_BUFFER = 8 << 20
"""The most that an unprivileged Linux process commonly gets, as the kernel accounts it."""
_WAIT_S = 0.1
"""How long the receiving thread sleeps at most; messages expire at this grain."""


class Link(Departures):
    """One end of a bridge: a bound socket with a sending and a receiving thread.

    Parameters
    ----------
    bind
        Host and port to receive at; port 0 takes a free one, see `address`.
    peer
        Where `send` sends to when it is not told otherwise. With a peer, datagrams are taken from
        it and from addresses that the link sends to; others are refused as `stranger`.
    on_message
        Called in the receiving thread with each message and its sender, from the first one on,
        which may be before the constructor returns. While it runs, nothing is received. An
        exception in it is counted as one of `errors`, logged, and ends nothing.
    receive_buffer
        Bytes to ask the kernel for, as the kernel accounts them; see the attribute.
    datagram
        `mtu`, `loopback` or the bytes of the largest datagram.
    signed_peer
        Keep to what a peer understands that reads the header's counts as signed.
    report
        Tell every sender once a second what arrived.
    confirmed
        The user tells of each message of a ROS type what became of it, by `published` or
        `dropped`. Otherwise it is published when `on_message` has returned.
    limits
        What reassembly spends at most.
    repair
        How lost datagrams of a topic are made good, by msg_type and topic; see `repair`. What is
        sent with `Resend` is kept until it is stale, so leave the body unchanged until then.
    large_waiting
        By msg_type and topic, the body bytes of messages of several parts that may wait, where
        those do not supersede each other: blocks of a whole. Otherwise only the newest waits.
    socket
        What to send and receive by instead of a socket of the link's own: anything bound that is
        used as `UdpSocket` is. It becomes the link's, which closes it; `bind` and
        `receive_buffer` are then as it has them, and so is who may send. Without it and without
        a peer, a socket that other hosts can reach validates addresses; see `address_guard`.

    Raises
    ------
    OSError
        When an address can't be resolved or bound.
    BadMessage
        When `datagram` is no datagram size, or `repair` needs a package that is not installed.
    """

    def __init__(
        self,
        bind: Address,
        peer: Optional[Address] = None,
        *,
        on_message: Optional[OnMessage] = None,
        receive_buffer: int = DEFAULT_RECEIVE_BUFFER,
        datagram: DatagramSize = "loopback",
        signed_peer: bool = False,
        report: bool = False,
        confirmed: bool = False,
        limits: Optional[Limits] = None,
        repair: Optional[RepairTable] = None,
        large_waiting: Optional[WaitingTable] = None,
        socket: Optional[DatagramSocket] = None,
    ) -> None:
        super().__init__(
            check_datagram_size(datagram), signed_peer=signed_peer, repair=check_table(repair)
        )
        self._peer = peer
        self._too_large = 0
        self._overhead = socket.overhead if socket is not None else 0
        self._large_waiting = large_waiting
        if peer is not None:
            self._outbox(peer)
        if socket is None:
            bare = UdpSocket(bind, receive_buffer=receive_buffer, wait_s=_WAIT_S)
            socket = guarded(bare, self._outbox(peer).to if peer is not None else None)
            self._vouch = getattr(socket, "vouch", self._vouch)
        self._socket = socket
        self._departs_by(socket)
        self._inbox = Inbox(
            receive_buffer=self.receive_buffer,
            on_credit=self._credited,
            on_report=self._reported,
            on_request=self._requested,
            on_send_order_done=self._order_is_over,
            on_challenge=self._challenged,
            limits=limits,
        )
        self._errors = ErrorCounter()
        self._listening = Listening(
            *(socket, self._inbox, on_message, self._answer, self._errors),
            report=report,
            confirmed=confirmed,
        )
        self._threads = [
            WorkerThread("udp_bridge receive", self._listening.turn, self._errors),
            WorkerThread("udp_bridge send", self._send_turn, self._errors),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def address(self) -> Address:
        """Host and port that the socket is bound to."""
        return self._socket.address

    @property
    def receive_buffer(self) -> int:
        """Bytes of the receive buffer that the kernel granted, as it accounts them."""
        return self._socket.receive_buffer

    @property
    def received(self) -> Counters:
        """What became of the datagrams that came."""
        return self._inbox.reassembler.counters

    def send(
        self,
        msg_type: int,
        topic: str,
        link: str,
        stamp_nanos: int,
        body: Buffer,
        to: Optional[Address] = None,
    ) -> None:
        """Send a message, or as much of it as may go now, and queue the rest; from any thread.

        It waits for no peer and no other message; the kernel's copying of up to 16 MB, which takes
        0.1 to 0.2 ms a MB, is done here, because to wake another thread takes longer. After `close`
        it does nothing.

        Parameters
        ----------
        msg_type, topic, link
            As in the header.
        stamp_nanos
            Nanoseconds since the POSIX epoch.
        body
            Any contiguous bytes-like object. It is not copied: leave it unchanged.
        to
            Where to; the link's peer when not given.

        Raises
        ------
        BadMessage
            When a field is out of range, or there is nowhere to send to.
        TooLarge
            When the message fits at no datagram size; also counted.
        """
        to = to if to is not None else self._peer
        if to is None:
            raise BadMessage("nowhere to send to: the link has no peer and no `to` was given")
        with self._lock:
            if self._is_closed:
                return
            outbox = self._routes.get(to) or self._outbox(to)
            express = None
            if not self._is_sending:
                express = outbox.express(
                    msg_type, topic, link, stamp_nanos, body
                ) or self._express_run(outbox, msg_type, topic, link, stamp_nanos, body)
            if express is not None:
                self._is_sending = True
            else:
                try:
                    outbox.put(Message(msg_type, topic, link, stamp_nanos, 0, body))
                except TooLarge:
                    self._too_large += 1
                    raise
        if express is not None:
            self._send(express)
            is_offered = express.run is not None and express.run.behind is not None
            if express.is_last and not self._is_relied_on and not is_offered:
                return
        self._send_at_once(AT_ONCE_BYTES)

    def mend(self, msg_type: int, topic: str, mode: Mode) -> None:
        """Make good what is lost of a topic from now on; from any thread.

        Raises
        ------
        BadMessage
            When that needs a package that is not installed.
        """
        check_table({(msg_type, topic): mode})
        with self._lock:
            self._repair[msg_type, topic] = mode
            for outbox in self._turn:
                outbox.mends(msg_type, topic)

    def left(self, to: Optional[Address] = None) -> Dict[Tuple[int, str], int]:
        """Return how many messages have left for `to`, or else the peer, by msg_type and topic."""
        to = to if to is not None else self._peer
        with self._lock:
            outbox = self._routes.get(to) if to is not None else None
            return outbox.accounts.left() if outbox is not None else {}

    def flush(self, timeout_s: float) -> bool:
        """Wait until all that was queued is sent; return whether it is."""
        return self._wait_idle(self._is_idle, timeout_s)

    def counters(self) -> Dict[str, Any]:
        """Return what was sent, received and lost, by name; `refused` is a dict by reason.

        `errors` counts exceptions that the link's threads survived: each is a bug, here or in
        `on_message`. `deaf` is 1 while the receiving thread has made no turn for 5 s.
        """
        with self._wake:
            outboxes = list(self._outboxes.values())
            counts: Dict[str, Any] = {
                **self._sent,
                "superseded": sum(outbox.superseded for outbox in outboxes),
                "too_large": self._too_large,
                "unreachable": self._socket.unreachable,
                "stalls": sum(outbox.pacer.stalls for outbox in outboxes),
                "resent": sum(outbox.resender.resent for outbox in outboxes),
                "resend_refused": sum(outbox.resender.over_budget for outbox in outboxes),
            }
        counts["sent_messages"] += self._inbox.socket_answers
        counts["sent_datagrams"] += self._inbox.socket_answers
        counts["sent_bytes"] += self._inbox.socket_answer_bytes
        counts["errors"] = self._errors.count
        counts["deaf"] = int(self._listening.is_deaf)
        counts["received_datagrams"] = self._inbox.datagrams
        counts["received_bytes"] = self._inbox.bytes_received
        counts["repaired"] = self.received.repaired
        counts["resend_requests"] = self._inbox.requests_sent
        counts["kernel_drops"] = self._socket.kernel_drops
        counts.update(self.received.as_dict())
        return counts

    def accounts(self, to: Optional[Address] = None) -> List[Account]:
        """Return what became of all that was sent to `to`, or else the peer, topic by topic."""
        to = to if to is not None else self._peer
        with self._wake:
            outbox = self._routes.get(to) if to is not None else None
            return outbox.accounts.rows(time.monotonic_ns()) if outbox is not None else []

    def arrivals(self) -> List[Tuple[Address, str, str, TopicReport]]:
        """Return sender, topic, link and report of what arrived, as told with `report` last."""
        return list(self._inbox.last_reports)

    def published(self, message: Message, sender: Address) -> None:
        """Tell, from any thread, that a message that was handed over has reached its user."""
        self._inbox.mark_published(message, sender, time.time_ns())

    def dropped(self, message: Message, sender: Address) -> None:
        """Tell, from any thread, that a message that was handed over won't reach its user."""
        self._inbox.mark_dropped(message, sender)

    def close(self) -> None:
        """End both threads at once; what waits is dropped, what is open counts as incomplete.

        With `report`, senders are told a last time what arrived.
        """
        with self._wake:
            if self._is_closed:
                return
            self._is_closed = True
            self._listening.end()
            self._wake.notify_all()
            self._idle.notify_all()
            self._wait_idle(lambda: not self._is_sending, _WAIT_S)
        self._socket.shut()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()
        self._listening.tell_last()
        self._socket.close()
        self._inbox.close()

    def __enter__(self) -> Link:
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        traceback: Optional[TracebackType],
    ) -> None:
        self.close()
