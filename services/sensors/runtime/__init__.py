# SPDX-License-Identifier: Apache-2.0
"""The process around a sensor model: states in, readings out, ledger of due readings.

Imported by every kind of sensor. Knows what a kind is, and none by name.
"""
