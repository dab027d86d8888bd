# SPDX-License-Identifier: Apache-2.0
"""Programs that throw garbage at a part of the system; the property is each one's first line."""
