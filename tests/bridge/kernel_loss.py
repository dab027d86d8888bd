# SPDX-License-Identifier: Apache-2.0
"""Two links in a network namespace whose kernel drops one datagram in twenty.

`unshare -n python -m tests.bridge.kernel_loss` prints, as JSON, what arrived with each repair mode
and how many datagrams the kernel dropped. It adds rules to its network namespace, so it refuses one
that has any other interface than `lo`. The namespace is removed when the process ends.
"""

import fcntl
import json
import random
import socket
import struct
import subprocess
import sys
import threading
import time

from udp_bridge import Link, Message
from udp_bridge.sender.repair import parse_mode
from udp_bridge.wire.message import Address

PORTS = (7510, 7511)
LOSS = 0.05
PARTS = 16
MESSAGES = 200
PERIOD_S = 0.01
LAST_S = 1.0
"""Wait for repairs; their limit is half of this."""
MODES: dict[str, object] = {"none": "none", "fec": {"fec": 0.25}, "resend": {"resend": 0.5}}
_SIOCSIFFLAGS, _UP_AND_RUNNING = 0x8914, 0x41


def main() -> int:
    """Measure and print."""
    if [name for _, name in socket.if_nameindex()] != ["lo"]:
        print(
            "not in a network namespace of its own. Fix: start it with `unshare -n`",
            file=sys.stderr,
        )
        return 2
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as control:
        flags = struct.pack("16sh22x", b"lo", _UP_AND_RUNNING)
        fcntl.ioctl(control, _SIOCSIFFLAGS, flags)
    for port in PORTS:
        rule = f"-A INPUT -i lo -p udp --dport {port} -m statistic --mode random"
        _iptables(*rule.split(), "--probability", str(LOSS), "-j", "DROP")
    print(json.dumps({"modes": {mode: _run(MODES[mode]) for mode in MODES}, "kernel": _drops()}))
    return 0


def _run(mode: object) -> dict[str, int]:
    """Return how many messages were sent, arrived, and arrived with different bytes."""
    sent: dict[int, bytes] = {}
    arrived: list[tuple[int, bytes]] = []
    lock = threading.Lock()
    here, there = (("127.0.0.1", port) for port in PORTS)

    def on_message(message: Message, _: Address) -> None:
        if message.msg_type == 1:
            with lock:
                arrived.append((message.stamp_nanos, bytes(message.body)))

    parsed = parse_mode(mode)
    table = {} if parsed is None else {(1, "/points"): parsed}
    rng = random.Random(1)
    with (
        Link(there, on_message=on_message),
        Link(here, there, datagram="mtu", repair=table) as sender,
    ):
        for _ in range(MESSAGES):
            stamp = time.time_ns()
            sent[stamp] = rng.randbytes(PARTS * 1400)
            sender.send(1, "/points", "lidar", stamp, sent[stamp])
            time.sleep(PERIOD_S)
        sender.flush(LAST_S)
        time.sleep(LAST_S)
        superseded = sender.counters()["superseded"]
    different = sum(sent.get(stamp) != body for stamp, body in arrived)
    return {"sent": MESSAGES - superseded, "arrived": len(arrived), "different": different}


def _drops() -> int:
    """Return how many datagrams the rules dropped."""
    listed = _iptables("-L", "INPUT", "-v", "-x", "-n").splitlines()
    return sum(int(line.split()[0]) for line in listed if "DROP" in line and "udp" in line)


def _iptables(*arguments: str) -> str:
    done = subprocess.run(
        ["iptables", "-w", *arguments], check=True, capture_output=True, text=True, timeout=20
    )
    return done.stdout


if __name__ == "__main__":
    sys.exit(main())
