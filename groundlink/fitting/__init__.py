# SPDX-License-Identifier: Apache-2.0
"""Data sheets from recordings of real devices: readings, their statistics, a sheet.

Imported by the command `groundlink fit` only. Knows no bus, service or process.
"""
