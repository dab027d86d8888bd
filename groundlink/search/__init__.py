# SPDX-License-Identifier: Apache-2.0
"""Search for failures: fields to vary, which point is next, shrinking, journal, coverage.

A point is a set of changed fields of a scenario; its run is exact, so a point is never run twice.
Commands and the report page import this package; it starts no process.
"""
