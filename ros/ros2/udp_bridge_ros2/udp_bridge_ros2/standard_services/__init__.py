# SPDX-License-Identifier: Apache-2.0
"""Services and an action of `simulation_interfaces`, the ROS 2 standard for simulators.

`table` lists them. A module beside it serves one group; the others are pure. Only these modules
import that package, and nothing imports them where it is not installed.
"""
