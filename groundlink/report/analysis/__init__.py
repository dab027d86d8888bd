# SPDX-License-Identifier: Apache-2.0
"""Analysis: the numbers of a report, read from a recording in one pass.

Imported by figures and pages of the report. Draws nothing and writes no HTML.
"""
