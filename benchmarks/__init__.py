# SPDX-License-Identifier: Apache-2.0
"""Measurements of the stated performance of Groundlink, each a command."""
