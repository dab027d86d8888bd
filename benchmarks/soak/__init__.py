# SPDX-License-Identifier: Apache-2.0
"""A soak of the bridge: loss, duplicates, restarts of both ends, flat memory."""
