# SPDX-License-Identifier: Apache-2.0
"""The satellite receiver's process."""
