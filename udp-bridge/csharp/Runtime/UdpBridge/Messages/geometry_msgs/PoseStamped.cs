// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>geometry_msgs/msg/PoseStamped.</summary>
    public sealed class PoseStamped : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.PoseStamped; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>In the frame of the header.</summary>
        public Pose Pose;

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            Pose.Write(to);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Pose.Read(from);
        }
    }
}
