# SPDX-License-Identifier: Apache-2.0
"""Link: one end of a bridge, with a UDP socket, a receiving thread and a sending thread.

Network errors are counted, not raised. The protocol itself is in `sender` and `receiver`.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Any, Callable, Dict, List, Optional, Tuple

from udp_bridge.receiver.delivery_log import Counters
from udp_bridge.receiver.inbox import Inbox
from udp_bridge.receiver.limits import Limits
from udp_bridge.sender.delivery_counts import DeliveryCounts
from udp_bridge.sender.direct_senders import DirectSenders
from udp_bridge.sender.flow_control import BATCH_BYTES, REQUEST_NANOS
from udp_bridge.sender.repair import Mode, RepairTable, check_table
from udp_bridge.sender.send_queue import OutgoingDatagram, SendQueue, take_in_turn
from udp_bridge.sender.waiting import QueueLimits
from udp_bridge.wire.address_validation import AddressChallenge, AddressResponse
from udp_bridge.wire.control import TopicReport
from udp_bridge.wire.fragments import DatagramSize, check_datagram_size
from udp_bridge.wire.header import NANOS, BadMessage, Buffer, Header
from udp_bridge.wire.message import Address, DatagramKey, Message, TopicKey
from udp_bridge.wire.repair import Request
from udp_bridge.wire.types import CONTROL

from .address_guard import guard
from .credit_mailbox import mailbox_for
from .receive_thread import OnMessage, ReceiveLoop
from .udp_socket import RECOMMENDED_BUFFER, DatagramSocket, UdpSocket, resolve
from .worker_thread import ErrorCounter, WorkerThread

DIRECT_BYTES = 1 << 24
"""Most bytes that `send` sends itself. Handing over would cost a fifth of the rate at 16 MB."""
_WAIT_S = 0.1
"""Longest sleep of the receiving thread, and so the resolution at which messages expire."""


class Link:
    """One end of a bridge.

    One thread at a time sends. If another thread is sending, `send` queues the message, and that
    thread drains the queue. The link's own sending thread only sends what has to wait.

    Parameters
    ----------
    bind
        Host and port to receive at; port 0 takes a free one, see `address`.
    peer
        Default destination of `send`. With a peer, datagrams are accepted from it and from
        addresses that the link sends to; others are refused as `stranger`.
    on_message
        Called in the receiving thread with each message and its sender, possibly before the
        constructor returns. Nothing is received while it runs; its exceptions are counted.
    receive_buffer
        Bytes to request of the kernel, in kernel bytes; see the attribute.
    datagram
        `mtu`, `loopback` or the bytes of the largest datagram.
    signed_peer
        Limit header counts for a peer that reads them as signed.
    report
        Report the outcome of received messages to their senders once a second.
    confirmed
        The user reports the outcome of each message of a ROS type by `published` or `dropped`.
        Otherwise a message counts as published when `on_message` has returned.
    limits
        Limits of reassembly.
    repair
        Repair modes by topic. Do not change a body sent with `Resend` until it is stale.
    queue_limits
        Body bytes of a topic's large messages that may wait; of others only the newest waits.
    socket
        A bound socket, such as a wrapper of `UdpSocket`; the link closes it. By default the link
        opens one with the protection that it needs; see `address_guard`.

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
        receive_buffer: int = RECOMMENDED_BUFFER,
        datagram: DatagramSize = "loopback",
        signed_peer: bool = False,
        report: bool = False,
        confirmed: bool = False,
        limits: Optional[Limits] = None,
        repair: Optional[RepairTable] = None,
        queue_limits: Optional[QueueLimits] = None,
        socket: Optional[DatagramSocket] = None,
    ) -> None:
        self._datagram = check_datagram_size(datagram)
        self._repair: Dict[TopicKey, Mode] = dict(check_table(repair))
        self._queue_options: Dict[str, Any] = {
            "signed_peer": signed_peer,
            "reserve": socket.overhead if socket is not None else 0,
            "limits": queue_limits,
        }
        self._peer = peer
        self._lock = threading.RLock()  # guards all that is below
        self._wake = threading.Condition(self._lock)  # of the sending thread
        self._idle = threading.Condition(self._lock)  # of threads that wait until all is sent
        self._idle_waiters = 0
        self._queues_by_name: Dict[Address, SendQueue] = {}  # by address as the user gave it
        self._queues: Dict[Address, SendQueue] = {}  # by numeric address
        self._turns: List[SendQueue] = []
        self._is_sending = self._is_closed = False
        self._has_more = False  # another thread queued something for the one that is sending
        self._sleeps_until_nanos = 0.0  # of the sending thread; 0 while it is awake
        self._rechecks = False  # something waits: the sending thread looks again before long
        self._sent = {"sent_messages": 0, "sent_datagrams": 0, "sent_bytes": 0}
        self._trust: Callable[[Address], object] = lambda _: None
        numeric = self._queue_for(peer).to if peer is not None else None
        if socket is None:
            socket = guard(UdpSocket(bind, receive_buffer=receive_buffer, wait_s=_WAIT_S), numeric)
            self._trust = getattr(socket, "trust", self._trust)
        self._socket = socket
        self._senders = DirectSenders.of(socket)
        self._send_batch: Any = getattr(socket, "send_batch", None)
        self._batch_bytes = BATCH_BYTES if self._send_batch is not None else 0
        self._mailbox = mailbox_for(getattr(socket, "credit_store", None), self._sent)
        self._inbox = Inbox(
            receive_buffer=socket.receive_buffer,
            on_credit=self._on_credit,
            on_report=self._on_report,
            on_request=self._on_request,
            on_delegation_done=self._on_delegated_end,
            on_challenge=self._on_challenge,
            limits=limits,
        )
        getattr(socket, "use_small_topics", lambda _: None)(self._inbox.small_topics)
        self._errors = ErrorCounter()
        self._receiving = ReceiveLoop(
            *(socket, self._inbox, on_message, self._answer, self._errors),
            report=report,
            confirmed=confirmed,
        )
        turns = {"receive": self._receiving.turn, "send": self._send_turn}
        self._threads = [WorkerThread(f"udp_bridge {n}", t, self._errors) for n, t in turns.items()]
        for thread in self._threads:
            thread.start()

    @property
    def address(self) -> Address:
        """Host and port that the socket is bound to."""
        return self._socket.address

    @property
    def receive_buffer(self) -> int:
        """Bytes of the receive buffer that the kernel granted, in kernel bytes."""
        return self._socket.receive_buffer

    @property
    def received(self) -> Counters:
        """Counters of the received datagrams."""
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
        """Send a message from any thread: as much as possible now, the rest from the queue.

        Up to 16 MB are copied into the kernel in the calling thread. After `close` it does nothing.

        Parameters
        ----------
        msg_type, topic, link, stamp_nanos
            As in the header; the stamp counts from the POSIX epoch.
        body
            Any contiguous bytes-like object. It is not copied, so do not change it.
        to
            Destination; the link's peer by default.

        Raises
        ------
        BadMessage
            When a field is out of range, there is no destination, or the message fits at no
            datagram size (`TooLarge`).
        """
        to = to if to is not None else self._peer
        if to is None:
            raise BadMessage("nowhere to send to: the link has no peer and no `to` was given")
        with self._lock:
            if self._is_closed:
                return
            queue = self._queues_by_name.get(to) or self._queue_for(to)
            datagram = None
            if not self._is_sending:
                now_nanos, fields = time.monotonic_ns(), (msg_type, topic, link, stamp_nanos, body)
                at_once = self._senders, self._turns, now_nanos
                size, sent, parts = queue.send_directly(*at_once, *fields)
                if parts:
                    if parts > 1:
                        self._mailbox.follow(queue, now_nanos)
                    self._count_sent(size, sent, is_last=sent == parts)
                    return
                datagram = self._take_large(queue, *fields)
            if datagram is None:
                queue.put(Message(msg_type, topic, link, stamp_nanos, 0, body))
            self._is_sending |= datagram is not None
        if datagram is not None:
            self._send(datagram)
            has_trailer = datagram.batch is not None and datagram.batch.trailer is not None
            if datagram.is_last and not self._has_more and not has_trailer:
                return
        self._send_queued(DIRECT_BYTES)

    def enable_repair(self, msg_type: int, topic: str, mode: Mode) -> None:
        """Set the repair mode of a topic; `BadMessage` if it needs a package that is missing."""
        check_table({(msg_type, topic): mode})
        with self._lock:
            self._repair[msg_type, topic] = mode
            for queue in self._turns:
                queue.forget_templates(msg_type, topic)

    def flush(self, timeout_s: float) -> bool:
        """Wait until the queues are empty; return whether they are."""
        return self._wait_idle(self._is_idle, timeout_s)

    def sent_counts(self, to: Optional[Address] = None) -> Dict[TopicKey, int]:
        """Return the number of messages sent to `to` (default: the peer) by topic."""
        with self._lock:
            queue = self._known_queue(to)
            return queue.delivery.sent() if queue is not None else {}

    def delivery_counts(self, to: Optional[Address] = None) -> List[DeliveryCounts]:
        """Return the outcome of all messages sent to `to` (default: the peer), by topic."""
        with self._lock:
            queue = self._known_queue(to)
            return queue.delivery.counts(time.monotonic_ns()) if queue is not None else []

    def arrivals(self) -> List[Tuple[Address, str, str, TopicReport]]:
        """Return the newest reports of received topics: sender, topic, link, report."""
        return list(self._inbox.last_reports)

    def published(self, message: Message, sender: Address) -> None:
        """Report, from any thread, that a received message reached its user."""
        self._inbox.mark_published(message, sender, time.time_ns())

    def dropped(self, message: Message, sender: Address) -> None:
        """Report, from any thread, that a received message will not reach its user."""
        self._inbox.mark_dropped(message, sender)

    def counters(self) -> Dict[str, Any]:
        """Return counts of what was sent, received and lost; `refused` is a dict by reason.

        `errors` are bugs. `deaf` is 1 if the receiving thread has been blocked for over 5 s.
        """
        with self._lock:
            queues = list(self._queues.values())
            counts: Dict[str, Any] = {
                **self._sent,
                "superseded": sum(queue.superseded for queue in queues),
                "too_large": sum(queue.too_large for queue in queues),
                "unreachable": self._socket.unreachable,
                "stalls": sum(queue.flow.stalls for queue in queues),
                "resent": sum(queue.resender.resent for queue in queues),
                "resend_refused": sum(queue.resender.over_budget for queue in queues),
            }
        inbox = self._inbox
        counts["sent_messages"] += inbox.socket_answers
        counts["sent_datagrams"] += inbox.socket_answers
        counts["sent_bytes"] += inbox.socket_answer_bytes
        counts.update(errors=self._errors.count, deaf=int(self._receiving.is_blocked))
        counts.update(received_datagrams=inbox.datagrams, received_bytes=inbox.bytes_received)
        counts.update(repaired=self.received.repaired, resend_requests=inbox.requests_sent)
        counts.update(kernel_drops=self._socket.kernel_drops, **self.received.as_dict())
        return counts

    def close(self) -> None:
        """Drop what waits, send a last report with `report`, and end both threads."""
        with self._lock:
            if self._is_closed:
                return
            self._is_closed = True
            self._receiving.end()
            self._wake.notify_all()
            self._idle.notify_all()
            self._wait_idle(lambda: not self._is_sending, _WAIT_S)
        self._socket.shut()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join()
        self._receiving.finish()
        self._socket.close()
        self._inbox.close()

    def __enter__(self) -> Link:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _known_queue(self, to: Optional[Address]) -> Optional[SendQueue]:
        return self._queues_by_name.get(to or self._peer or ("", 0))

    def _queue_for(self, to: Address) -> SendQueue:
        numeric = resolve(to)
        queue = self._queues.get(numeric)
        if queue is None:
            queue = SendQueue(numeric, self._datagram, repair=self._repair, **self._queue_options)
            self._queues[numeric] = queue
            self._turns.append(queue)
            self._trust(numeric)
        self._queues_by_name[to] = queue
        return queue

    def _take_large(self, queue: SendQueue, *fields: Any) -> Optional[OutgoingDatagram]:
        """Return the first parts of a large message if all queues are empty."""
        if not all(queue.is_idle for queue in self._turns):
            return None
        now_nanos = time.monotonic_ns()
        if queue.flow.is_mostly_used:
            self._mailbox.collect(now_nanos, is_awaited=False)
        datagram = queue.take_large_directly(now_nanos, self._batch_bytes, *fields)
        if datagram is not None:
            self._mailbox.follow(queue, now_nanos)
        return datagram

    def _send_queued(self, most_bytes: int) -> None:
        """Send what may be sent now, in the calling thread, because waking ours takes longer."""
        left_bytes = most_bytes
        while left_bytes > 0:
            with self._lock:
                datagram = None if self._is_closed else self._take()
                if datagram is None:
                    break
            left_bytes -= self._send(datagram)
        with self._lock:
            if self._is_sending:
                self._has_more = True
            elif self._sleeps_until_nanos:
                now_nanos = time.monotonic_ns()
                if left_bytes <= 0:  # this thread does not send the rest
                    self._mailbox.collect(now_nanos, is_awaited=True)
                    self._mailbox.delegate()
                next_wake_nanos = self._next_wake(now_nanos)
                self._rechecks |= next_wake_nanos < math.inf
                if next_wake_nanos < self._sleeps_until_nanos:
                    self._wake.notify_all()

    def _take(self) -> Optional[OutgoingDatagram]:
        """Return what to send now, unless another thread is sending; `_send` must follow."""
        self._has_more = self._is_sending
        if self._is_sending:
            return None
        now_nanos = time.monotonic_ns()
        self._mailbox.collect(now_nanos, is_awaited=False)
        datagram = take_in_turn(self._turns, now_nanos, self._batch_bytes)
        if datagram is None and self._mailbox.collect(now_nanos, is_awaited=True):
            datagram = take_in_turn(self._turns, now_nanos, self._batch_bytes)
        if datagram is None:
            self._mailbox.delegate()
        elif datagram.batch is not None:
            self._mailbox.follow(self._turns[-1], now_nanos)
        self._is_sending = datagram is not None
        return datagram

    def _send(self, datagram: OutgoingDatagram) -> int:
        """Send what was taken, without the lock; return its bytes."""
        batch = datagram.batch
        count, size, sent, trailers = 1, len(datagram.header) + datagram.part.nbytes, 0, 0
        has_failed = True
        try:
            if batch is not None:
                count = batch.parts_count
                sent = self._send_batch(batch, datagram.to)
                size = batch.size if sent == count else sent * batch.datagram_size
                if batch.trailer is not None:
                    trailers = int(self._socket.send((batch.trailer,), datagram.to))
                    size += trailers * len(batch.trailer)
            else:
                sent = int(self._socket.send((datagram.header, datagram.part), datagram.to))
            has_failed = False
        finally:
            with self._lock:
                self._is_sending = False
                self._count_sent(size, sent + trailers, is_last=datagram.is_last and sent == count)
                if self._idle_waiters and self._is_idle():
                    self._idle.notify_all()
                if has_failed:
                    self._wake.notify_all()  # the sending thread sends the rest
        return size

    def _send_turn(self) -> bool:
        """Send what waits, or sleep until something may be sent; return False after `close`."""
        with self._lock:
            if self._is_closed:
                return False
            datagram = self._take()
            if datagram is None:
                self._sleep()
                return True
        self._send(datagram)
        return True

    def _sleep(self) -> None:
        """Let the sending thread wait; another thread that is sending sends the rest."""
        now_nanos = time.monotonic_ns()
        self._sleeps_until_nanos = math.inf if self._is_sending else self._next_wake(now_nanos)
        if self._rechecks:  # cheaper than waking this thread for each full window
            self._sleeps_until_nanos = min(self._sleeps_until_nanos, now_nanos + REQUEST_NANOS)
            self._rechecks = False
        if self._idle_waiters:
            self._idle.notify_all()  # messages may have become stale while they waited
        wait_nanos = self._sleeps_until_nanos - now_nanos
        self._wake.wait(None if wait_nanos == math.inf else max(0.0, wait_nanos) / NANOS)
        self._sleeps_until_nanos = 0.0

    def _next_wake(self, now_nanos: int) -> float:
        """Return when something may be sent if nothing happens; infinity if nothing waits."""
        wakes = [queue.next_wake(now_nanos) for queue in self._turns]
        return min((wake for wake in wakes if wake is not None), default=math.inf)

    def _is_idle(self) -> bool:
        is_busy = self._is_sending or not all(queue.is_idle for queue in self._turns)
        return self._is_closed or not is_busy

    def _wait_idle(self, is_idle: Callable[[], bool], timeout_s: float) -> bool:
        with self._lock:
            if is_idle():
                return True
            self._idle_waiters += 1
            try:
                return self._idle.wait_for(is_idle, timeout_s)
            finally:
                self._idle_waiters -= 1

    def _count_sent(self, size: int, datagrams: int, *, is_last: bool) -> None:
        if datagrams:
            self._sent["sent_datagrams"] += datagrams
            self._sent["sent_bytes"] += size
            self._sent["sent_messages"] += is_last

    def _answer(self, answer: bytes, to: Address) -> None:
        is_sent = self._socket.send([answer], to)
        with self._lock:
            self._count_sent(len(answer), int(is_sent), is_last=is_sent)

    def _on_credit(self, sender: Address, key: DatagramKey, receive_buffer: int) -> None:
        with self._lock:
            if (queue := self._queues.get(sender)) is None:
                return
            now_nanos = time.monotonic_ns()
            self._mailbox.collect(now_nanos, is_awaited=True)  # these Credits came before
            queue.flow.credited(key, receive_buffer, now_nanos)
            if queue.is_idle:
                return
            if self._datagram != "loopback":
                self._wake.notify_all()
                return
        # On one host, sending takes less time than waking a thread; over a network it may block.
        self._send_queued(BATCH_BYTES)

    def _on_request(self, sender: Address, header: Header, request: Request) -> None:
        with self._lock:
            if (queue := self._queues.get(sender)) is not None:
                now_nanos = time.monotonic_ns()
                self._mailbox.collect(now_nanos, is_awaited=True)  # delegated parts count as sent
                queue.resender.requested(header, request, now_nanos)
        self._send_queued(BATCH_BYTES)

    def _on_report(self, sender: Address, topic: str, report: TopicReport, nanos: int) -> None:
        with self._lock:
            if (queue := self._queues.get(sender)) is not None:
                queue.delivery.reported(topic, report, nanos)

    def _on_challenge(self, sender: Address, challenge: AddressChallenge) -> None:
        if sender not in self._queues:
            return  # this link does not send there, so it needs no validation
        response = Header(CONTROL, 0, 0, 1, 0, 0).pack() + AddressResponse(challenge.cookie).pack()
        self._answer(response, sender)

    def _on_delegated_end(self) -> None:
        with self._lock:
            now_nanos = time.monotonic_ns()
            self._mailbox.collect(now_nanos, is_awaited=True)
            if self._is_idle() and self._next_wake(now_nanos) > now_nanos:  # no offer is due
                if self._idle_waiters:
                    self._idle.notify_all()
                return
        self._send_queued(BATCH_BYTES)
