# SPDX-License-Identifier: Apache-2.0
"""What a report shows, as numbers: read from a recording in one pass.

Imported by figures and pages of the report. Draws nothing and writes no HTML.
"""
