# SPDX-License-Identifier: Apache-2.0
"""Verdicts on the expectations of a scenario: what they refer to, trackers, results, JUnit XML.

Pure: messages and times are arguments. The loader, the monitor of a run, recordings and the command
line import it. It opens no file and no bus.
"""
