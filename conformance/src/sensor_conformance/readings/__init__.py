# SPDX-License-Identifier: Apache-2.0
"""Messages of a topic as arrays: a class for each family of types, and the recording of them all.

Uses `sources` and `signals`. Nothing here judges data.
"""
