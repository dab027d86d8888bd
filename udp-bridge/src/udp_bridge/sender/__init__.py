# SPDX-License-Identifier: Apache-2.0
"""Sending half: queues, credit window, retransmission, forward error correction, delivery accounts.

Imported by `io`. Sans-IO: time and bytes are arguments.
"""
