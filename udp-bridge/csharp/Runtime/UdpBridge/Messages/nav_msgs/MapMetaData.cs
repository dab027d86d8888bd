// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>nav_msgs/msg/MapMetaData.</summary>
    public struct MapMetaData
    {
        /// <summary>When the map was loaded.</summary>
        public Time MapLoadTime;

        /// <summary>Edge of a cell in m.</summary>
        public float Resolution;

        /// <summary>Cells along x.</summary>
        public uint Width;

        /// <summary>Cells along y.</summary>
        public uint Height;

        /// <summary>Of the corner of cell 0 in the frame of the map.</summary>
        public Pose Origin;

        internal void Write(CdrWriter to)
        {
            MapLoadTime.Write(to);
            to.Write(Resolution);
            to.Write(Width);
            to.Write(Height);
            Origin.Write(to);
        }

        internal void Read(CdrReader from)
        {
            MapLoadTime.Read(from);
            Resolution = from.ReadSingle();
            Width = from.ReadUInt32();
            Height = from.ReadUInt32();
            Origin.Read(from);
        }
    }
}
