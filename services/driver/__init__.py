# SPDX-License-Identifier: Apache-2.0
"""Driver: steers a vehicle along its route with velocity commands, as a ROS node would.

Imported by nobody. It gets states from the bus and publishes commands; it never touches physics.
"""
