# SPDX-License-Identifier: Apache-2.0
"""Sockets and threads: the `Link`, its UDP socket, wrappers, and batches of datagrams.

May be imported by `cli`, `node` and users of a link.
Never decides about the protocol: `sender` and `receiver` do, without clocks and sockets.
"""
