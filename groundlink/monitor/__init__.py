# SPDX-License-Identifier: Apache-2.0
"""Monitoring of a run: supervised processes, health messages, stream statistics.

Imported by the command line and the viewer. Never controls the run itself.
"""
