# SPDX-License-Identifier: Apache-2.0
"""Puts a recorded run on the bus again."""
