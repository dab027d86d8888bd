# SPDX-License-Identifier: Apache-2.0
"""Driver: steers a vehicle along its route with velocity commands, as a ROS node would."""
