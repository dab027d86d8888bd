// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>geometry_msgs/msg/Pose.</summary>
    public struct Pose
    {
        /// <summary>In m.</summary>
        public Point Position;

        /// <summary>Of unit length.</summary>
        public Quaternion Orientation;

        internal void Write(CdrWriter to)
        {
            Position.Write(to);
            Orientation.Write(to);
        }

        internal void Read(CdrReader from)
        {
            Position.Read(from);
            Orientation.Read(from);
        }
    }
}
