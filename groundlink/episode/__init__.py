# SPDX-License-Identifier: Apache-2.0
"""Parts of an episode (from start or reset to the next): journal, commands, routes, missions.

Imported by physics, the driver, recordings and the command line. Opens no session.
"""
