# SPDX-License-Identifier: Apache-2.0
"""Receiving half: reassembly, ordering, limits, negative acknowledgements, delivery reports.

Imported by `io`. Sans-IO: time and bytes are arguments.
"""
