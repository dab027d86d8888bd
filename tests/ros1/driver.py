# SPDX-License-Identifier: Apache-2.0
"""A ROS 1 user's teleoperation: drives straight on until it is ended."""

import time

import rospy
from geometry_msgs.msg import Twist

rospy.init_node("driver")
publisher = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
twist = Twist()
twist.linear.x = 0.5
while not rospy.is_shutdown():
    publisher.publish(twist)
    time.sleep(0.05)
