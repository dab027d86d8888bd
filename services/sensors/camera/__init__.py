# SPDX-License-Identifier: Apache-2.0
"""The colour camera's process."""
