# SPDX-License-Identifier: Apache-2.0
"""What two processes of a run must agree on: topics, messages, bus, time, scenario, world."""

__version__ = "0.1.0"
