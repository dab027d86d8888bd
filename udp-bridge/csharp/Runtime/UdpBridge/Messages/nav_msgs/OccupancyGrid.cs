// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>nav_msgs/msg/OccupancyGrid: a map of cells.</summary>
    public sealed class OccupancyGrid : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.OccupancyGrid; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>Size and place of the map.</summary>
        public MapMetaData Info;

        /// <summary>Row-major from the origin: -1 unknown, 0..100 percent occupied.</summary>
        public sbyte[] Data = new sbyte[0];

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            Info.Write(to);
            to.Write(Data);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Info.Read(from);
            Data = from.ReadSBytes();
        }
    }
}
