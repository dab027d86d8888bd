# SPDX-License-Identifier: Apache-2.0
"""Faults that are planted on purpose, to see whether a test finds each of them."""
