# SPDX-License-Identifier: Apache-2.0
"""Receiving half of a link: reassembly, order, limits, negative acknowledgements, reports.

Imported by `io`; imports `wire` only. Never touches a socket, a thread or a clock: time and bytes
are arguments. A datagram goes `Inbox.receive` -> `Reassembler.accept` -> `Assembly.add` ->
`DeliveryRules.deliver_in_order`; parts that the socket receives in place start at
`Inbox.receive_batch`.
"""
