// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge
{
    /// <summary>Kind 1 of Control, PROTOCOL.md, section 6: what became of the messages of a topic,
    /// counted by their receiver.</summary>
    public sealed class TopicReport
    {
        internal const int Size = 128;
        internal const long NoAge = long.MinValue;

        /// <summary>Of the reported topic.</summary>
        public MessageType Type { get; internal set; }

        /// <summary>Lowest number of which a datagram arrived.</summary>
        public uint FirstNumber { get; internal set; }

        /// <summary>The receiver's wall clock at the first report of this count.</summary>
        public long SinceNanos { get; internal set; }

        /// <summary>Messages from the first to the one with the highest number.</summary>
        public ulong Numbers { get; internal set; }

        /// <summary>Messages that reached their user.</summary>
        public ulong Published { get; internal set; }

        /// <summary>Whole messages that the user did not take.</summary>
        public ulong Dropped { get; internal set; }

        /// <summary>Messages given up with parts missing.</summary>
        public ulong Incomplete { get; internal set; }

        /// <summary>Whole messages behind a newer one.</summary>
        public ulong Late { get; internal set; }

        /// <summary>Messages whose parts are awaited, or that wait to be published.</summary>
        public ulong Pending { get; internal set; }

        /// <summary>Messages that would be incomplete without repair.</summary>
        public ulong Repaired { get; internal set; }

        /// <summary>Datagrams that had arrived before.</summary>
        public ulong Duplicates { get; internal set; }

        /// <summary>Bytes of the bodies of the messages published.</summary>
        public ulong BodyBytes { get; internal set; }

        /// <summary>Stamp of the first message of which a datagram arrived.</summary>
        public long FirstSeenStampNanos { get; internal set; }

        /// <summary>Stamp of the first message published; 0 without any.</summary>
        public long FirstStampNanos { get; internal set; }

        /// <summary>Stamp of the last message published; 0 without any.</summary>
        public long LastStampNanos { get; internal set; }

        /// <summary>Median of the ages; <see cref="long.MinValue"/> without any.</summary>
        public long AgeP50Nanos { get; internal set; }

        /// <summary>Age that 99 % of the messages do not exceed.</summary>
        public long AgeP99Nanos { get; internal set; }

        // Read a body that ControlBody.Check found valid.
        internal static TopicReport Parse(ArraySegment<byte> body)
        {
            byte[] data = body.Array;
            int at = body.Offset;
            Func<int, ulong> counted = place => Wire.ReadU64(data, at + place);
            Func<int, long> signed = place => unchecked((long)Wire.ReadU64(data, at + place));
            return new TopicReport
            {
                Type = (MessageType)data[at + 1],
                FirstNumber = Wire.ReadU32(data, at + 4),
                SinceNanos = signed(8),
                Numbers = counted(16),
                Published = counted(24),
                Dropped = counted(32),
                Incomplete = counted(40),
                Late = counted(48),
                Pending = counted(56),
                Repaired = counted(64),
                Duplicates = counted(72),
                BodyBytes = counted(80),
                FirstSeenStampNanos = signed(88),
                FirstStampNanos = signed(96),
                LastStampNanos = signed(104),
                AgeP50Nanos = signed(112),
                AgeP99Nanos = signed(120),
            };
        }

        internal byte[] Pack()
        {
            var body = new byte[Size];
            body[0] = ControlBody.TopicReport;
            body[1] = (byte)Type;
            Wire.WriteU32(body, 4, FirstNumber);
            Action<int, ulong> counted = (place, value) => Wire.WriteU64(body, place, value);
            Action<int, long> signed = (place, value) => counted(place, unchecked((ulong)value));
            signed(8, SinceNanos);
            counted(16, Numbers);
            counted(24, Published);
            counted(32, Dropped);
            counted(40, Incomplete);
            counted(48, Late);
            counted(56, Pending);
            counted(64, Repaired);
            counted(72, Duplicates);
            counted(80, BodyBytes);
            signed(88, FirstSeenStampNanos);
            signed(96, FirstStampNanos);
            signed(104, LastStampNanos);
            signed(112, AgeP50Nanos);
            signed(120, AgeP99Nanos);
            return body;
        }
    }
}
