# SPDX-License-Identifier: Apache-2.0
"""The contract between the processes of a run: topics, messages, bus, time, scenario, world."""

__version__ = "0.1.0"
