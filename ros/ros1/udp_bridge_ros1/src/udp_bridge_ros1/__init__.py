# SPDX-License-Identifier: Apache-2.0
"""ROS 1 end of UDP Bridge: publish messages from datagrams and send commands back."""
