# SPDX-License-Identifier: Apache-2.0
"""Calls services of the bridge's node, which the arguments name, and prints what they say."""

import sys

import rospy
from std_srvs.srv import Trigger

rospy.init_node("caller", anonymous=True)
for name in sys.argv[1:]:
    rospy.wait_for_service(f"/udp_bridge/{name}", timeout=20)
    answer = rospy.ServiceProxy(f"/udp_bridge/{name}", Trigger)()
    print(f"{name}: {answer.success}: {answer.message}", flush=True)
