# SPDX-License-Identifier: Apache-2.0
"""Measurements of what Groundlink promises, each a command."""
