# SPDX-License-Identifier: Apache-2.0
"""Recording a drive through the whole chain, and reading what was recorded."""
