# SPDX-License-Identifier: Apache-2.0
"""Delegated sends that are reclaimed while Credits arrive: the process of `test_delegated_sends`.

It prints how often a send was delegated. It hangs if two threads wait for each other.
"""

import socket
import sys
import threading
from collections import deque

from udp_bridge import Message
from udp_bridge.io.credit_mailbox import CreditMailbox
from udp_bridge.io.udp_socket import UdpSocket
from udp_bridge.receiver.receive_slots import NO_SLOTS, CreditState
from udp_bridge.sender.send_queue import SendQueue
from udp_bridge.wire.control import Credit
from udp_bridge.wire.control import parse as parse_control
from udp_bridge.wire.header import Header
from udp_bridge.wire.message import DatagramKey
from udp_bridge.wire.types import CONTROL

LOCAL = ("127.0.0.1", 0)
ROUNDS = 300
BODY = bytes(650_000)
RECEIVE_BUFFER = 1 << 20


def main() -> None:
    """Play the peer that gives credits, the link that sends, and a user's thread that computes."""
    sys.setswitchinterval(1e-4)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        # No more than fits: what the kernel drops here nobody sends again.
        window = peer.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2
        peer.bind(LOCAL)
        ours = UdpSocket(LOCAL, receive_buffer=RECEIVE_BUFFER, wait_s=0.05)
        is_over = threading.Event()
        awaited: deque[tuple[DatagramKey, int]] = deque()

        def receive() -> None:
            while not is_over.is_set():
                run = ours.receive_batch(NO_SLOTS, CreditState(0, RECEIVE_BUFFER, 0))
                if run is not None and run.unmatched is not None:
                    told = parse_control(run.unmatched[-12:])
                    assert isinstance(told, Credit)
                    key = DatagramKey(33, "/image", told.seq_number, told.part_number)
                    awaited.append((key, told.receive_buffer))

        def give() -> None:
            """Give a credit for every other part that came, each in a datagram of its own."""
            peer.settimeout(0.05)
            while not is_over.is_set():
                try:
                    raw = peer.recv(1 << 16)
                except TimeoutError:
                    continue
                if raw[6] % 2 or raw[6] == raw[7] - 1:
                    number = int.from_bytes(raw[2:6], "little")
                    header = Header(CONTROL, 1, 0, 1, 5, 6, "/image").pack()
                    body = Credit(33, raw[6], number, window).pack()
                    peer.sendto(header + body, ours.address)

        def compute() -> None:
            while not is_over.is_set():
                pass

        threads = [threading.Thread(target=target) for target in (receive, give, compute)]
        for thread in threads:
            thread.start()
        queue = SendQueue(peer.getsockname(), "loopback")
        sent = dict.fromkeys(("sent_messages", "sent_datagrams", "sent_bytes"), 0)
        mailbox = CreditMailbox(ours.credit_store, sent)
        delegated = 0
        for stamp in range(ROUNDS):
            queue.flow.acknowledged(DatagramKey(33, "", 0, 0), window, 0)
            queue.put(Message(33, "/image", "", stamp, 0, BODY))
            while not queue.is_idle:
                mailbox.collect(0, is_awaited=False)
                while awaited:
                    queue.flow.acknowledged(*awaited.popleft(), 0)
                datagram = queue.take(0, 1 << 18)
                if datagram is not None and datagram.batch is not None:
                    ours.send_batch(datagram.batch, datagram.to)
                    mailbox.follow(queue, 0)
                elif datagram is None:
                    mailbox.collect(0, is_awaited=True)
                    mailbox.delegate()
                    delegated += mailbox._delegated is not None
        is_over.set()
        for thread in threads:
            thread.join()
        ours.close()
    print(delegated)


if __name__ == "__main__":
    main()
