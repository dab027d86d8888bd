# SPDX-License-Identifier: Apache-2.0
"""Command `udp-bridge`: decode a recording, listen at a port, send one message.

Messages go to standard output, everything else to standard error. A wrong argument gives one line
and exit code 2. Bodies are not decoded.
"""

from __future__ import annotations

import _thread
import argparse
import hashlib
import json
import os
import signal
import sys
import threading
import time
from typing import Any, Dict, List, NoReturn, Optional

from udp_bridge.io.address_guard import open_socket
from udp_bridge.io.link import Link
from udp_bridge.io.udp_socket import buffer_hint
from udp_bridge.receiver.delivery_log import Counters
from udp_bridge.receiver.reassembly import Reassembler
from udp_bridge.wire.capture import BadRecording, datagrams
from udp_bridge.wire.fragments import DatagramSize, check_datagram_size, plan
from udp_bridge.wire.header import NANOS
from udp_bridge.wire.keys import read_key
from udp_bridge.wire.message import Address, Message
from udp_bridge.wire.seal import FROM_ROS, TO_ROS
from udp_bridge.wire.types import MSG_TYPES, type_number

DATAGRAM_NANOS = 1000
"""Assumed time between two recorded datagrams, because recordings have no times. A message is thus
given up after two million datagrams or at the end."""
SEND_TIMEOUT_S = 30.0
"""The largest message takes 0.4 s to a peer that sends no Credits."""
LINGER_S = 0.1
"""How long `send` waits for an ICMP error from the peer's host."""


def main(argv: Optional[List[str]] = None) -> int:
    """Run the command line; return the exit code."""
    arguments = _parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
        return code
    except BrokenPipeError:
        # The reader closed the pipe, so nothing may be flushed at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (OSError, ValueError) as error:
        print(f"udp-bridge: {_error_text(error)}", file=sys.stderr)
        return 2


def _decode(arguments: argparse.Namespace) -> int:
    reassembler = Reassembler()
    with open(arguments.file, "rb") as file:
        try:
            for index, datagram in enumerate(datagrams(file)):
                message = reassembler.receive(datagram, "", index * DATAGRAM_NANOS)
                if message is not None:
                    _show(message, as_json=arguments.json)
        except BadRecording as error:
            raise BadRecording(f"{arguments.file}: {error}") from None
    reassembler.give_up_all()
    _show_counters(reassembler.counters, as_json=arguments.json)
    return 0


def _listen(arguments: argparse.Namespace) -> int:
    has_ended = threading.Event()
    failures: List[OSError] = []

    def on_message(message: Message, sender: Address) -> None:
        try:
            _show(message, as_json=arguments.json)
        except OSError as error:  # the main thread reports it
            failures.append(error)
            has_ended.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        # Another thread: the main thread may hold the event's lock when the signal comes.
        signal.signal(number, lambda *_: _thread.start_new_thread(has_ended.set, ()))
    shown = None if arguments.quiet else on_message
    socket = open_socket(
        arguments.bind,
        peer=arguments.peer,
        secret=read_key(arguments.key_file, arguments.key_env, os.environ),
        sends=FROM_ROS,
        allow_any_peer=arguments.allow_any_peer,
    )
    with Link(arguments.bind, on_message=shown, report=arguments.report, socket=socket) as link:
        host, port = link.address
        print(f"udp-bridge: listening at {host}:{port}", file=sys.stderr, flush=True)
        if hint := buffer_hint(link.receive_buffer):
            print(f"udp-bridge: {hint}", file=sys.stderr, flush=True)
        has_ended.wait(arguments.duration)
    if failures:
        raise failures[0]
    _show_counters(link.received, as_json=arguments.json)
    return 0


def _send(arguments: argparse.Namespace) -> int:
    with open(arguments.body, "rb") as file:
        body = file.read()
    here = ("0.0.0.0", 0)
    # A message of a type to ROS comes from a gateway, any other one from a ROS node.
    sends = TO_ROS if MSG_TYPES[arguments.type].direction == "to ROS" else FROM_ROS
    socket = open_socket(
        here,
        peer=arguments.to,
        secret=read_key(arguments.key_file, arguments.key_env, os.environ),
        sends=sends,
    )
    with Link(here, arguments.to, datagram=arguments.datagram, socket=socket) as link:
        stamp_nanos = time.time_ns()
        link.send(arguments.type, arguments.topic, arguments.link, stamp_nanos, body)
        is_sent = link.flush(SEND_TIMEOUT_S)
        time.sleep(LINGER_S)
        counters = link.counters()
    name = MSG_TYPES[arguments.type].name
    host, port = arguments.to
    message = Message(arguments.type, arguments.topic, arguments.link, stamp_nanos, 0, body)
    cut = plan(message, arguments.datagram, reserve=socket.overhead)
    what = f"{name} of {len(body)} bytes in {cut.parts_max} part{'s' * (cut.parts_max > 1)}"
    print(f"udp-bridge: sent {what} to {host}:{port}", file=sys.stderr)
    if counters["unreachable"]:
        print(f"udp-bridge: no process listens at {host}:{port}", file=sys.stderr)
    if not is_sent:
        print(f"udp-bridge: gave up after {SEND_TIMEOUT_S:.0f} s", file=sys.stderr)
    return 0 if is_sent else 1


def _show(message: Message, *, as_json: bool) -> None:
    if not as_json:
        print(message, flush=True)
        return
    time_sec, time_nsec = divmod(message.stamp_nanos, NANOS)
    _print_json(
        {
            "msg_type": message.msg_type,
            "seq_number": message.seq_number,
            "time_sec": time_sec,
            "time_nsec": time_nsec,
            "topic": message.topic,
            "link": message.link,
            "parts": message.parts,
            "body_size": len(message.body),
            "body_sha256": hashlib.sha256(message.body).hexdigest(),
        }
    )


def _show_counters(counters: Counters, *, as_json: bool) -> None:
    counts = counters.as_dict()
    if as_json:
        _print_json(counts)
        return
    refused = counts.pop("refused")
    text = ", ".join(f"{name} {count}" for name, count in counts.items())
    reasons = ", ".join(f"{reason} {count}" for reason, count in sorted(refused.items()))
    print(f"{text}, refused {sum(refused.values())}" + (f" ({reasons})" if reasons else ""))


def _print_json(row: Dict[str, Any]) -> None:
    print(json.dumps(row), flush=True)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="udp-bridge", description="Decode, receive and send messages.")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)

    decode = commands.add_parser("decode", help="show the messages in a file of datagrams")
    decode.set_defaults(run=_decode)
    decode.add_argument("file", metavar="FILE", help="datagrams, each after its length as uint32")

    listen = commands.add_parser("listen", help="show the messages that arrive at a port")
    listen.set_defaults(run=_listen)
    listen.add_argument("--bind", metavar="HOST:PORT", type=_address, required=True)
    listen.add_argument(
        "--peer", metavar="HOST:PORT", type=_address, help="accept datagrams from this address only"
    )
    listen.add_argument(
        "--allow-any-peer",
        action="store_true",
        help="accept datagrams from any address although other hosts can reach the port",
    )
    listen.add_argument("--duration", metavar="S", type=_duration, help="end after S seconds")
    listen.add_argument("--report", action="store_true", help="send reports to the senders")
    listen.add_argument("--quiet", action="store_true", help="print only the counters at the end")
    for command in (decode, listen):
        command.add_argument("--json", action="store_true", help="print one JSON object per line")

    send = commands.add_parser("send", help="send one message")
    send.set_defaults(run=_send)
    send.add_argument("--to", metavar="HOST:PORT", type=_address, required=True)
    send.add_argument("--type", metavar="N", type=_type, required=True, help="number or name")
    send.add_argument("--topic", metavar="T", default="", help="default: the type's own")
    send.add_argument("--link", metavar="L", default="", help="frame of the data; default: none")
    send.add_argument("--body", metavar="FILE", required=True, help="the message as CDR bytes")
    send.add_argument(
        "--datagram",
        metavar="SIZE",
        type=_datagram,
        default="loopback",
        help="mtu, loopback (default) or bytes",
    )
    for command in (listen, send):
        command.add_argument("--key-file", metavar="FILE", help="file with the shared key")
        command.add_argument("--key-env", metavar="NAME", help="environment variable with the key")
    return parser


def _address(text: str) -> Address:
    host, colon, port = text.rpartition(":")
    if not (host and colon and port.isdecimal() and int(port) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT with a port of 0..65535")
    return host, int(port)


def _duration(text: str) -> float:
    try:
        duration = float(text)
    except ValueError:
        duration = -1.0
    if not 0 <= duration < threading.TIMEOUT_MAX:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of seconds")
    return duration


def _type(text: str) -> int:
    if not text.isdecimal():
        try:
            return type_number(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None
    if int(text) not in MSG_TYPES:
        known = ", ".join(map(str, MSG_TYPES))
        raise argparse.ArgumentTypeError(f"unknown message type {text}; known are {known}")
    return int(text)


def _datagram(text: str) -> DatagramSize:
    try:
        return check_datagram_size(int(text) if text.isdecimal() else text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _error_text(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    return str(error)
