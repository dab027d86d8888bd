# SPDX-License-Identifier: Apache-2.0
"""The journal that reproduces a run, and the routes that vehicles follow.

Imported by physics, the driver, recordings and the command line. Opens no session.
"""
