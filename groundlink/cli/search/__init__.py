# SPDX-License-Identifier: Apache-2.0
"""Commands that run a scenario many times, each run as a process of its own."""
