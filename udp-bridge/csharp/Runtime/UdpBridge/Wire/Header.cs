// SPDX-License-Identifier: Apache-2.0

using System;
using System.Text;

namespace UdpBridge
{
    /// <summary>The header of a datagram, PROTOCOL.md, section 2.</summary>
    public struct Header
    {
        /// <summary>What the body is.</summary>
        public MessageType Type { get; set; }

        /// <summary>Number of the message, per sender, type and topic.</summary>
        public uint SeqNumber { get; set; }

        /// <summary>Index of this part, from 0.</summary>
        public byte PartNumber { get; set; }

        /// <summary>How many parts the message has.</summary>
        public byte PartsMax { get; set; }

        /// <summary>The instant of measurement in POSIX seconds, rounded down.</summary>
        public int TimeSec { get; set; }

        /// <summary>Nanoseconds of that second.</summary>
        public int TimeNsec { get; set; }

        /// <summary>ROS topic name; empty stands for the type's default topic.</summary>
        public string Topic { get; set; }

        /// <summary>Frame of the data; empty where there is none.</summary>
        public string Link { get; set; }

        /// <summary>The instant of measurement in nanoseconds since the POSIX epoch.</summary>
        public long StampNanos
        {
            get { return TimeSec * Wire.Nanos + TimeNsec; }
        }

        // Set the stamp; return false where it is beyond what the wire has.
        internal bool SetStamp(long nanos)
        {
            long nsec = (nanos % Wire.Nanos + Wire.Nanos) % Wire.Nanos, sec = (nanos - nsec) / Wire.Nanos;
            TimeSec = unchecked((int)sec);
            TimeNsec = (int)nsec;
            return TimeSec == sec;
        }

        /// <summary>Write the header at the beginning of a buffer of 256 bytes or more.</summary>
        /// <returns>Its bytes; 0 where it is illegal: nothing is written then.</returns>
        public int Pack(byte[] to)
        {
            int topicSize, linkSize;
            try
            {
                topicSize = Wire.Utf8.GetByteCount(Topic);
                linkSize = Wire.Utf8.GetByteCount(Link);
            }
            catch (EncoderFallbackException)
            {
                return 0;
            }
            bool hasNul = Topic.IndexOf('\0') >= 0 || Link.IndexOf('\0') >= 0;
            bool isTime = TimeNsec >= 0 && TimeNsec < Wire.Nanos;
            if (topicSize + linkSize > Wire.LargestNames || hasNul || !isTime) return 0;
            if (PartNumber >= PartsMax) return 0;
            int end = Wire.FixedSize + topicSize + linkSize, size = (end + 3) / 4 * 4;
            to[0] = (byte)Type;
            to[1] = (byte)size;
            Wire.WriteU32(to, 2, SeqNumber);
            to[6] = PartNumber;
            to[7] = PartsMax;
            Wire.WriteU32(to, 8, unchecked((uint)TimeSec));
            Wire.WriteU32(to, 12, (uint)TimeNsec);
            to[16] = (byte)topicSize;
            to[17] = (byte)linkSize;
            Wire.Utf8.GetBytes(Topic, 0, Topic.Length, to, Wire.FixedSize);
            Wire.Utf8.GetBytes(Link, 0, Link.Length, to, Wire.FixedSize + topicSize);
            Array.Clear(to, end, size - end);
            return size;
        }

        /// <summary>Read the header of a datagram of so many bytes.</summary>
        /// <param name="data">The datagram, from the first byte on.</param>
        /// <param name="size">Its bytes.</param>
        /// <param name="header">What it says.</param>
        /// <param name="headerSize">Where the body begins.</param>
        /// <returns>Null, or why it is refused, in the words of PROTOCOL.md, section 7.</returns>
        public static string Parse(byte[] data, int size, out Header header, out int headerSize)
        {
            header = new Header();
            headerSize = 0;
            if (size < Wire.FixedSize) return size == 0 ? "empty" : "short";
            headerSize = data[1];
            if (headerSize < 20) return "header_size_small";
            if (headerSize > size) return "header_size_past_end";
            if (headerSize % 4 != 0) return "header_size_unaligned";
            header.Type = (MessageType)data[0];
            header.SeqNumber = Wire.ReadU32(data, 2);
            header.PartNumber = data[6];
            header.PartsMax = data[7];
            if (header.PartsMax == 0) return "parts_zero";
            if (header.PartNumber >= header.PartsMax) return "part_past_parts";
            header.TimeSec = unchecked((int)Wire.ReadU32(data, 8));
            header.TimeNsec = unchecked((int)Wire.ReadU32(data, 12));
            if (header.TimeNsec < 0) return "nsec_negative";
            if (header.TimeNsec >= Wire.Nanos) return "nsec_too_big";
            int topicEnd = Wire.FixedSize + data[16], linkEnd = topicEnd + data[17];
            if (topicEnd > headerSize) return "topic_past_header";
            if (linkEnd > headerSize) return "link_past_header";
            if (headerSize - linkEnd > 3) return "header_size_large";
            if (!Wire.IsUtf8(data, Wire.FixedSize, data[16])) return "topic_not_utf8";
            if (Array.IndexOf(data, (byte)0, Wire.FixedSize, data[16]) >= 0) return "topic_nul";
            if (!Wire.IsUtf8(data, topicEnd, data[17])) return "link_not_utf8";
            if (Array.IndexOf(data, (byte)0, topicEnd, data[17]) >= 0) return "link_nul";
            header.Topic = Wire.Utf8.GetString(data, Wire.FixedSize, data[16]);
            header.Link = Wire.Utf8.GetString(data, topicEnd, data[17]);
            if (data[0] == Wire.SealedType) return "sealed";
            return Wire.IsKnown(data[0]) ? null : "unknown_type";
        }
    }
}
