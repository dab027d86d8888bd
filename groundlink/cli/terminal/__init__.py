# SPDX-License-Identifier: Apache-2.0
"""Terminal input and output: tables, live displays, keys.

Imported by commands. Contains nothing about runs or file formats.
"""
