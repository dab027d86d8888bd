# SPDX-License-Identifier: Apache-2.0
"""Conformance kit for simulators that serve `simulation_interfaces` 2.1, the ROS 2 standard.

`clauses/` holds the clauses of the standard, one test each. `client.py` is their hand on the
simulator, `plugin.py` the pytest plugin that selects and reports them.
It imports rclpy, simulation_interfaces and pytest, and no simulator.
"""
