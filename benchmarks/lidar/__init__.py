# SPDX-License-Identifier: Apache-2.0
"""What the LiDAR costs, and what others take for the same rays."""
