# SPDX-License-Identifier: Apache-2.0
"""A run over time: the journal that repeats it, and the routes that vehicles drive.

Imported by physics, the driver, recordings and the command line. Opens no session.
"""
