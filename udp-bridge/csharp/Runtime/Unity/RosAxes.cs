// SPDX-License-Identifier: Apache-2.0

using UnityEngine;
using Ros = UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Converts between the axes of ROS (right-handed: x forward, y left, z up) and of Unity
    /// (left-handed: x right, y up, z forward). Unity's (x, y, z) is (-y, z, x) of ROS. This mirrors
    /// space, so rotations also change their sense: what turns about an axis has the other sign.
    /// </summary>
    public static class RosAxes
    {
        /// <summary>Return a point, a direction or a velocity in Unity's axes.</summary>
        public static Vector3 ToUnity(Ros.Vector3 ros)
        {
            return new Vector3((float)-ros.Y, (float)ros.Z, (float)ros.X);
        }

        /// <summary>Return a point, a direction or a velocity in the axes of ROS.</summary>
        public static Ros.Vector3 ToRos(Vector3 unity)
        {
            return new Ros.Vector3 { X = unity.z, Y = -unity.x, Z = unity.y };
        }

        /// <summary>Return an angular velocity in Unity's axes, in the same unit. A turn to the left,
        /// +z of ROS, is -y of Unity.</summary>
        public static Vector3 AngularToUnity(Ros.Vector3 ros)
        {
            return -ToUnity(ros);
        }

        /// <summary>Return an angular velocity in the axes of ROS, in the same unit.</summary>
        public static Ros.Vector3 AngularToRos(Vector3 unity)
        {
            return ToRos(-unity);
        }

        /// <summary>Return a rotation in Unity's axes.</summary>
        public static Quaternion ToUnity(Ros.Quaternion ros)
        {
            return new Quaternion((float)ros.Y, (float)-ros.Z, (float)-ros.X, (float)ros.W);
        }

        /// <summary>Return a rotation in the axes of ROS.</summary>
        public static Ros.Quaternion ToRos(Quaternion unity)
        {
            return new Ros.Quaternion { X = -unity.z, Y = unity.x, Z = -unity.y, W = unity.w };
        }
    }
}
