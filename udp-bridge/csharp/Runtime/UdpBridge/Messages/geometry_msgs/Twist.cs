// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>geometry_msgs/msg/Twist: a velocity in the axes of ROS, x forward, y left, z up.</summary>
    public sealed class Twist : IRosMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.Twist; }
        }

        /// <summary>In m/s.</summary>
        public Vector3 Linear;

        /// <summary>In rad/s.</summary>
        public Vector3 Angular;

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Linear.Write(to);
            Angular.Write(to);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Linear.Read(from);
            Angular.Read(from);
        }
    }
}
