# SPDX-License-Identifier: Apache-2.0
"""Prints each message of the topics in the arguments as a JSON line [topic, 0, its bytes]."""

import json
import sys

import rospy


def take(message: rospy.AnyMsg, topic: str) -> None:
    print(json.dumps([topic, 0, message._buff.hex()]), flush=True)


rospy.init_node("bytes_listener", anonymous=True)
for name in sys.argv[1:]:
    rospy.Subscriber(name, rospy.AnyMsg, take, callback_args=name, queue_size=100)
rospy.spin()
