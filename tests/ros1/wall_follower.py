# SPDX-License-Identifier: Apache-2.0
"""The wall follower as a node of ROS 1: ``wall_follower.py LAPS``, its decisions in PYTHONPATH."""

import sys
import threading
from typing import Any

import rospy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from wall_following import Scan, WallFollower

rospy.init_node("wall_follower")
follower = WallFollower(int(sys.argv[1]))
deciding = threading.Lock()  # rospy has a thread for each topic
publisher = rospy.Publisher("/cmd_vel", Twist, queue_size=100)


def decide() -> None:
    for forward, turn in follower.decisions():
        twist = Twist()
        twist.linear.x, twist.angular.z = forward, turn
        publisher.publish(twist)


def scan(message: Any) -> None:
    at = message.header.stamp.to_nsec(), message.angle_min, message.angle_increment
    with deciding:
        follower.scan(Scan(*at, list(message.ranges)))
        decide()


def odometry(message: Any) -> None:
    turned = message.pose.pose.orientation
    with deciding:
        follower.odometry(message.header.stamp.to_nsec(), turned.z, turned.w)
        decide()


rospy.Subscriber("/scan", LaserScan, scan, queue_size=100, tcp_nodelay=True)
rospy.Subscriber("/odom", Odometry, odometry, queue_size=100, tcp_nodelay=True)
rospy.spin()
