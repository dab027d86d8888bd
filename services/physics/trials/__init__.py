# SPDX-License-Identifier: Apache-2.0
"""Trials of a single vehicle on a test track: what it can do, in figures and curves.

Started by `groundlink try`, and used by the tests of shipped vehicles. Joins no bus.
"""
