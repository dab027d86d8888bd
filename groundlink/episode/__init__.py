# SPDX-License-Identifier: Apache-2.0
"""Parts of an episode (a run from start or reset to the next): journal, commands, faults, routes.

Imported by physics, the driver, recordings and the command line. Opens no session.
"""
