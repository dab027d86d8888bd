// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/CompressedImage.</summary>
    public sealed class CompressedImage : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.CompressedImage; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>Such as jpeg or png.</summary>
        public string Format = "";

        /// <summary>The file.</summary>
        public byte[] Data = new byte[0];

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            to.Write(Format);
            to.Write(Data);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Format = from.ReadString();
            Data = from.ReadBytes();
        }
    }
}
