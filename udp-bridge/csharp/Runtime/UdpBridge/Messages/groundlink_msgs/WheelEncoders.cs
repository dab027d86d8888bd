// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>groundlink_msgs/msg/WheelEncoders.</summary>
    public sealed class WheelEncoders : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.WheelEncoders; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>Of each wheel.</summary>
        public string[] Name = new string[0];

        /// <summary>Counted by each encoder since the start.</summary>
        public long[] Ticks = new long[0];

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            to.Write(Name);
            to.Write(Ticks);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Name = from.ReadStrings();
            Ticks = from.ReadInt64s();
        }
    }
}
