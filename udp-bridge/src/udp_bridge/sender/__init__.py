# SPDX-License-Identifier: Apache-2.0
"""Sending half: queues, flow control, retransmission, forward error correction, delivery counts.

May be imported by `io`, `node` and users of a link.
Never opens a socket, reads a clock or imports `receiver`: time and bytes are arguments.
"""
