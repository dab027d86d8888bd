# SPDX-License-Identifier: Apache-2.0
"""Link emulation: loss, delay, rate limits and outages of datagrams.

Imported by the scenario, the gateway and the relay. Pure: time is an argument; no sockets, no
threads.
"""
