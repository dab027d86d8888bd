# SPDX-License-Identifier: Apache-2.0
"""Random numbers and errors of sensors, as functions of seed, purpose and tick.

Imported by sensor models. Keeps no state between measurements.
"""
