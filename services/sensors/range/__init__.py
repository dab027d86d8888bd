# SPDX-License-Identifier: Apache-2.0
"""The range finder's process."""
