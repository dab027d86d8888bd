# SPDX-License-Identifier: Apache-2.0
"""What commands print and read on a terminal: tables, live displays, keys.

Imported by commands. Knows no run and no file format.
"""
