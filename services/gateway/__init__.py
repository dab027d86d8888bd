# SPDX-License-Identifier: Apache-2.0
"""Gateway: sends the streams of a run to ROS over UDP, and publishes messages from ROS on the bus.

Imported by nobody. The only service that speaks both the bus and the UDP Bridge; it never reads
scenario files and never computes physics or readings.
"""
