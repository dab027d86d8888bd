# SPDX-License-Identifier: Apache-2.0
"""Reports: a recording as one HTML page.

Imported by `groundlink report`. Reads recordings only; never joins a bus.
"""
