// SPDX-License-Identifier: Apache-2.0

using System;
using System.Text;

namespace UdpBridge
{
    /// <summary>Numbers of the wire, and how they lie in bytes.</summary>
    public static class Wire
    {
        /// <summary>Nanoseconds of a second.</summary>
        public const long Nanos = 1000000000;

        /// <summary>Bytes of the largest datagram that IPv4 carries.</summary>
        public const int LargestDatagram = 65507;

        /// <summary>Preset: datagrams that an Ethernet frame carries whole, in bytes.</summary>
        public const int Mtu = 1472;

        /// <summary>Preset: parts of 65 280 bytes, for one host.</summary>
        public const int Loopback = 0;

        internal const int FixedSize = 18;
        internal const int LargestNames = 234;
        internal const int LoopbackPart = 65280;
        internal const int MostParts = 255;
        internal const byte ResendType = 65;
        internal const byte RepairType = 66;
        internal const byte SealedType = 68;

        // Throws at lone surrogates, which no UTF-8 stands for.
        internal static readonly UTF8Encoding Utf8 = new UTF8Encoding(false, true);

        private static readonly bool[] Known = KnownTypes();

        /// <summary>Whether a message of this type has a ROS type: its body is CDR.</summary>
        public static bool HasRosType(byte type)
        {
            return Known[type] && type != (byte)MessageType.Subscribe
                && type != (byte)MessageType.Control;
        }

        internal static bool IsKnown(byte type)
        {
            return Known[type];
        }

        // Whether PROTOCOL.md, section 4, has this type, which this version need not take.
        internal static bool IsInTable(byte type)
        {
            return Known[type] || type == ResendType || type == RepairType;
        }

        internal static uint ReadU32(byte[] from, int at)
        {
            return from[at] | (uint)from[at + 1] << 8 | (uint)from[at + 2] << 16
                | (uint)from[at + 3] << 24;
        }

        internal static void WriteU32(byte[] to, int at, uint value)
        {
            for (int i = 0; i < 4; ++i) to[at + i] = unchecked((byte)(value >> 8 * i));
        }

        internal static ulong ReadU64(byte[] from, int at)
        {
            return ReadU32(from, at) | (ulong)ReadU32(from, at + 4) << 32;
        }

        internal static void WriteU64(byte[] to, int at, ulong value)
        {
            for (int i = 0; i < 8; ++i) to[at + i] = unchecked((byte)(value >> 8 * i));
        }

        // UTF-8 as RFC 3629 has it: no surrogates, nothing longer than it needs to be.
        internal static bool IsUtf8(byte[] text, int at, int size)
        {
            for (int end = at + size; at < end;)
            {
                byte lead = text[at];
                int more, low = 0x80, high = 0xBF;
                if (lead < 0x80) more = 0;
                else if (lead >= 0xC2 && lead <= 0xDF) more = 1;
                else if (lead >= 0xE0 && lead <= 0xEF) more = 2;
                else if (lead >= 0xF0 && lead <= 0xF4) more = 3;
                else return false;
                if (lead == 0xE0) low = 0xA0;
                if (lead == 0xED) high = 0x9F;
                if (lead == 0xF0) low = 0x90;
                if (lead == 0xF4) high = 0x8F;
                if (end - at <= more) return false;
                for (int i = 1; i <= more; ++i, low = 0x80, high = 0xBF)
                {
                    if (text[at + i] < low || text[at + i] > high) return false;
                }
                at += more + 1;
            }
            return true;
        }

        private static bool[] KnownTypes()
        {
            var known = new bool[256];
            foreach (MessageType type in Enum.GetValues(typeof(MessageType))) known[(byte)type] = true;
            return known;
        }
    }
}
