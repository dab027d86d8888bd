# SPDX-License-Identifier: Apache-2.0
"""Sensors: one folder a kind, and what all kinds share."""
