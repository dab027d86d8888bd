# SPDX-License-Identifier: Apache-2.0
"""Watching a run: child processes, health reports, stream totals.

Imported by the command line. Decides nothing for the run itself.
"""
