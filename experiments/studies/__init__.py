# SPDX-License-Identifier: Apache-2.0
"""The experiments themselves, one module a study."""
