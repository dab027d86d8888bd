# SPDX-License-Identifier: Apache-2.0
"""The process of odometry by wheel encoders."""
