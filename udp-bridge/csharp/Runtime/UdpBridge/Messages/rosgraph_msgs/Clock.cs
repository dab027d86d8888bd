// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>rosgraph_msgs/msg/Clock: the time of nodes with use_sim_time.</summary>
    public sealed class Clock : IRosMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.Clock; }
        }

        /// <summary>The field clock.</summary>
        public Time Value;

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Value.Write(to);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Value.Read(from);
        }
    }
}
