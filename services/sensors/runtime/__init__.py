# SPDX-License-Identifier: Apache-2.0
"""Process around a sensor model: state input, reading output and the ledger of due readings.

Every sensor kind imports this package. The package handles sensor kinds only through their
interface and imports none of them.
"""
