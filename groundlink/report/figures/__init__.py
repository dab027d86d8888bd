# SPDX-License-Identifier: Apache-2.0
"""The figures of a report, drawn with Matplotlib as SVG.

Imported by pages of the report. Reads no recording.
"""
