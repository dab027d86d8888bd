# SPDX-License-Identifier: Apache-2.0
"""Sockets and threads: the `Link`, its UDP socket, wrappers and batched system calls.

The only package of the library that reads clocks and opens sockets, besides `cli` and `node`.
"""
