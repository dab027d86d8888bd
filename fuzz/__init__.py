# SPDX-License-Identifier: Apache-2.0
"""Fuzzers: each is a command whose first docstring line states the property that it checks."""
