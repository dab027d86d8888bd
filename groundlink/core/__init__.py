# SPDX-License-Identifier: Apache-2.0
"""Errors, sim time, field types, frames and other basics of every package.

May be imported by every package. Imports nothing else of Groundlink.
"""

VERSION = "0.1.0"
"""Version of Groundlink."""
