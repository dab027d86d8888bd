# SPDX-License-Identifier: Apache-2.0
"""The depth camera's process."""
