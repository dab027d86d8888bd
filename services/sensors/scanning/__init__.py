# SPDX-License-Identifier: Apache-2.0
"""What every LiDAR with a turning head shares, in space or in a plane."""
