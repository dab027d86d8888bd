# SPDX-License-Identifier: Apache-2.0
"""The ROS 1 end of UDP Bridge: datagrams become messages, commands go back."""
