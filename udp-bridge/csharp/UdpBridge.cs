// SPDX-License-Identifier: Apache-2.0
//
// UDP Bridge, version 1, for .NET and Unity: datagrams in, whole messages out, and the way back.
//
// The rules are those of ../PROTOCOL.md, sections 1 to 8; repair (types 65 and 66) and sealed
// datagrams (type 68) are refused and counted, as PROTOCOL.md allows.
// Bytes and time are arguments: nothing here opens a socket, reads a clock, starts a thread or
// takes a lock, so that it serves Unity's main loop and a thread of its own alike. Bodies are CDR
// and not decoded here. It validates no addresses (section 11): beyond the own host, give it
// datagrams of known peers alone. Needs .NET Standard 2.0 and C# 7.3, no other library and no
// unsafe code.

using System;
using System.Collections.Generic;
using System.Text;

namespace UdpBridge
{
    /// <summary>The types of messages, PROTOCOL.md, section 4, that this version takes.</summary>
    public enum MessageType : byte
    {
        /// <summary>sensor_msgs/msg/PointCloud2, to ROS.</summary>
        PointCloud2 = 1,
        /// <summary>sensor_msgs/msg/Imu, to ROS.</summary>
        Imu = 2,
        /// <summary>sensor_msgs/msg/CompressedImage, to ROS.</summary>
        CompressedImage = 3,
        /// <summary>sensor_msgs/msg/NavSatFix, to ROS.</summary>
        NavSatFix = 4,
        /// <summary>groundlink_msgs/msg/WheelEncoders, to ROS.</summary>
        WheelEncoders = 5,
        /// <summary>sensor_msgs/msg/Range, to ROS.</summary>
        Range = 6,
        /// <summary>The bridge's own.</summary>
        Subscribe = 7,
        /// <summary>rosgraph_msgs/msg/Clock, to ROS.</summary>
        Clock = 8,
        /// <summary>geometry_msgs/msg/Twist, from ROS.</summary>
        Twist = 9,
        /// <summary>geometry_msgs/msg/PoseStamped, both ways.</summary>
        PoseStamped = 10,
        /// <summary>nav_msgs/msg/OccupancyGrid, from ROS.</summary>
        OccupancyGrid = 11,
        /// <summary>sensor_msgs/msg/LaserScan, to ROS.</summary>
        LaserScan = 32,
        /// <summary>sensor_msgs/msg/Image, to ROS.</summary>
        Image = 33,
        /// <summary>sensor_msgs/msg/CameraInfo, to ROS.</summary>
        CameraInfo = 34,
        /// <summary>tf2_msgs/msg/TFMessage, to ROS.</summary>
        TFMessage = 35,
        /// <summary>nav_msgs/msg/Odometry, both ways.</summary>
        Odometry = 36,
        /// <summary>sensor_msgs/msg/JointState, both ways.</summary>
        JointState = 37,
        /// <summary>geometry_msgs/msg/TwistStamped, from ROS.</summary>
        TwistStamped = 38,
        /// <summary>std_msgs/msg/String, to ROS.</summary>
        String = 39,
        /// <summary>nav_msgs/msg/Path, from ROS.</summary>
        Path = 40,
        /// <summary>The bridge's own.</summary>
        Control = 64,
        /// <summary>Any ROS type, named in the body, both ways.</summary>
        Typed = 67,
    }

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

    /// <summary>A whole message.</summary>
    public sealed class Message
    {
        internal Message(Header header, byte[] body)
        {
            header.PartNumber = 0;
            Header = header;
            Body = body;
        }

        /// <summary>The header of its part 0.</summary>
        public Header Header { get; }

        /// <summary>CDR for types that ROS has; nobody else keeps or changes it.</summary>
        public byte[] Body { get; }
    }

    /// <summary>Type 67: a message of the ROS type that the body names, PROTOCOL.md, section 4.1.</summary>
    public struct Typed
    {
        private const string Middle = "/msg/";

        /// <summary>Full ROS 2 type name, such as sensor_msgs/msg/MagneticField.</summary>
        public string RosType { get; set; }

        /// <summary>Where the CDR begins in the body, a multiple of 8.</summary>
        public int Offset { get; set; }

        /// <summary>Return the body of a message; null where the type is not package/msg/Name.</summary>
        /// <param name="rosType">Full ROS 2 type name.</param>
        /// <param name="cdr">The complete message in CDR, at the beginning of this buffer.</param>
        /// <param name="size">Its bytes.</param>
        public static byte[] Pack(string rosType, byte[] cdr, int size)
        {
            if (!IsName(rosType)) return null;
            int offset = (rosType.Length + 8) / 8 * 8;
            var body = new byte[offset + size];
            body[0] = (byte)rosType.Length;
            Encoding.ASCII.GetBytes(rosType, 0, rosType.Length, body, 1);
            Array.Copy(cdr, 0, body, offset, size);
            return body;
        }

        /// <summary>Read the beginning of a body.</summary>
        /// <returns>Null, or why a receiver drops the message: type_name.</returns>
        public static string Parse(byte[] body, out Typed to)
        {
            to = new Typed();
            if (body.Length == 0) return "type_name";
            to.Offset = (body[0] + 8) / 8 * 8;
            if (to.Offset > body.Length) return "type_name";
            var name = new char[body[0]];
            for (int i = 0; i < name.Length; ++i) name[i] = (char)body[1 + i];
            to.RosType = new string(name);
            return IsName(to.RosType) ? null : "type_name";
        }

        // Whether a text matches [a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]* and has at most 255 bytes.
        private static bool IsName(string text)
        {
            int slash = text.IndexOf('/'), name = slash + Middle.Length;
            if (text.Length > 255 || slash < 1 || name >= text.Length) return false;
            if (string.CompareOrdinal(text, slash, Middle, 0, Middle.Length) != 0) return false;
            if (!IsLower(text[0]) || !IsUpper(text[name])) return false;
            for (int i = 0; i < slash; ++i)
            {
                if (!IsLower(text[i]) && !IsDigit(text[i]) && text[i] != '_') return false;
            }
            for (int i = name; i < text.Length; ++i)
            {
                if (!IsLower(text[i]) && !IsUpper(text[i]) && !IsDigit(text[i])) return false;
            }
            return true;
        }

        private static bool IsLower(char c)
        {
            return c >= 'a' && c <= 'z';
        }

        private static bool IsUpper(char c)
        {
            return c >= 'A' && c <= 'Z';
        }

        private static bool IsDigit(char c)
        {
            return c >= '0' && c <= '9';
        }
    }

    /// <summary>The body of type 7: a request of the topic that the header names.</summary>
    public struct Subscribe
    {
        /// <summary>Type of the wanted messages, one with a ROS type.</summary>
        public MessageType WantedType { get; set; }

        /// <summary>False to be sent it no longer.</summary>
        public bool Wanted { get; set; }

        /// <summary>Seconds until the request expires unless it is repeated; 0: until unsubscribed.</summary>
        public ushort LeaseSeconds { get; set; }

        /// <summary>Highest rate wanted in Hz; 0: all.</summary>
        public float MaxRateHz { get; set; }

        /// <summary>Return the 8 bytes of the body.</summary>
        public byte[] Pack()
        {
            var body = new byte[8];
            body[0] = (byte)WantedType;
            body[1] = (byte)(Wanted ? 1 : 0);
            body[2] = unchecked((byte)LeaseSeconds);
            body[3] = (byte)(LeaseSeconds >> 8);
            byte[] rate = BitConverter.GetBytes(MaxRateHz);
            if (!BitConverter.IsLittleEndian) Array.Reverse(rate);
            rate.CopyTo(body, 4);
            return body;
        }

        /// <summary>Read a body; return null, or why it is refused.</summary>
        public static string Parse(byte[] body, out Subscribe to)
        {
            to = new Subscribe();
            return Parse(body, 0, body.Length, out to);
        }

        internal static string Parse(byte[] data, int at, int size, out Subscribe to)
        {
            to = new Subscribe();
            if (size != 8) return "body_size";
            to.WantedType = (MessageType)data[at];
            to.Wanted = data[at + 1] == 1;
            to.LeaseSeconds = (ushort)(data[at + 2] | data[at + 3] << 8);
            var rate = new[] { data[at + 4], data[at + 5], data[at + 6], data[at + 7] };
            if (!BitConverter.IsLittleEndian) Array.Reverse(rate);
            to.MaxRateHz = BitConverter.ToSingle(rate, 0);
            bool isRate = to.MaxRateHz >= 0 && !float.IsInfinity(to.MaxRateHz);
            bool isLegal = Wire.HasRosType(data[at]) && data[at + 1] <= 1 && isRate;
            return isLegal ? null : "body_value";
        }
    }

    // The bodies of Control, PROTOCOL.md, section 6.
    internal static class ControlBody
    {
        internal const byte CreditRequest = 3, AddressChallenge = 8, AddressResponse = 9;
        internal const int CreditSize = 12, ReportSize = 128;
        internal const long NoAge = long.MinValue;

        private const int LinkReportSize = 40, ReasonSize = 9, MostReasons = 32, LongestName = 32;
        private const int Numbers = 16, Counts = 24, CountsEnd = 64;  // places of uint64s

        // Return null, or why a body is refused.
        internal static string Check(byte[] data, int at, int size)
        {
            if (size == 0) return "body_size";
            switch (data[at])
            {
                case 0: return CheckTyped(data, at, size == CreditSize);
                case 1: return CheckReport(data, at, size);
                case 2: return CheckLinkReport(data, at, size);
                case CreditRequest: return size == 4 ? null : "body_size";
                case AddressChallenge:
                case AddressResponse: return size == 16 ? null : "body_size";
                default: return "body_value";
            }
        }

        private static string CheckTyped(byte[] data, int at, bool isSize)
        {
            if (!isSize) return "body_size";
            return Wire.IsInTable(data[at + 1]) ? null : "body_value";
        }

        // The five counts are at most as many as the numbers; their sum could overflow.
        private static string CheckReport(byte[] data, int at, int size)
        {
            if (size != ReportSize) return "body_size";
            ulong left = Wire.ReadU64(data, at + Numbers);
            for (int place = Counts; place < CountsEnd; place += 8)
            {
                ulong count = Wire.ReadU64(data, at + place);
                if (count > left) return "body_value";
                left -= count;
            }
            return CheckTyped(data, at, true);
        }

        private static string CheckLinkReport(byte[] data, int at, int size)
        {
            if (size < LinkReportSize) return "body_size";
            int end = at + size;
            at += LinkReportSize;
            for (int i = 0; i < MostReasons && at < end; ++i)
            {
                if (end - at < ReasonSize) return "body_size";
                int name = data[at + ReasonSize - 1];
                at += ReasonSize;
                if (end - at < name) return "body_size";
                if (name == 0 || name > LongestName) return "body_value";
                for (; name > 0; --name, ++at)
                {
                    byte c = data[at];
                    bool isLetter = c >= 'a' && c <= 'z', isDigit = c >= '0' && c <= '9';
                    if (!isLetter && !isDigit && c != '_') return "body_value";
                }
            }
            return at == end ? null : "body_size";
        }
    }

    // What became of the messages of one topic until its sender restarts; each gets one result,
    // among the newest 1024.
    internal sealed class Arrivals
    {
        internal enum Result
        {
            Published,
            Incomplete,
            Late,
        }

        private const int Remembered = 1024, AgesKept = 1024;
        private const long AgesNanos = 10 * Wire.Nanos;

        private readonly long[] counts = new long[3];
        private readonly State[] states = new State[Remembered];  // by number modulo its length
        private readonly Queue<KeyValuePair<long, long>> published
            = new Queue<KeyValuePair<long, long>>();  // when, and the stamp
        private uint firstNumber, highest;
        private long numbers, bodyBytes, firstSeenStamp, firstStamp, lastStamp;
        private long? since;  // the first report gives it

        private enum State : byte
        {
            Unknown,
            Open,
            Settled,
        }

        internal void Seen(uint number, long stampNanos)
        {
            if (numbers == 0) firstSeenStamp = stampNanos;
            See(number);
        }

        internal void Publish(uint number, long stampNanos, int size, long nowNanos)
        {
            if (!Settle(number, Result.Published)) return;
            if (counts[(int)Result.Published] == 1) firstStamp = stampNanos;
            lastStamp = stampNanos;
            bodyBytes += size;
            published.Enqueue(new KeyValuePair<long, long>(nowNanos, stampNanos));
            if (published.Count > AgesKept) published.Dequeue();
        }

        // Give a message its result; return false where it has one, or is too old.
        internal bool Settle(uint number, Result result)
        {
            See(number);
            if (unchecked(highest - number) >= Remembered) return false;
            if (states[number % Remembered] == State.Settled) return false;
            states[number % Remembered] = State.Settled;
            ++counts[(int)result];
            return true;
        }

        internal byte[] Report(byte type, long duplicates, long nowNanos, long wallNanos)
        {
            since = since ?? wallNanos;
            while (published.Count > 0 && nowNanos - published.Peek().Key > AgesNanos)
            {
                published.Dequeue();
            }
            var ages = new List<long>();
            foreach (KeyValuePair<long, long> one in published)
            {
                ages.Add(wallNanos - (nowNanos - one.Key) - one.Value);
            }
            ages.Sort();
            long pending = 0;
            foreach (State state in states) pending += state == State.Open ? 1 : 0;
            var body = new byte[ControlBody.ReportSize];
            body[0] = 1;
            body[1] = type;
            Wire.WriteU32(body, 4, firstNumber);
            var values = new[]
            {
                since.Value, numbers, counts[(int)Result.Published], 0, counts[(int)Result.Incomplete],
                counts[(int)Result.Late], pending, 0, duplicates, bodyBytes, firstSeenStamp,
                firstStamp, lastStamp, Percentile(ages, 50), Percentile(ages, 99),
            };
            for (int i = 0; i < values.Length; ++i)
            {
                Wire.WriteU64(body, 8 + 8 * i, unchecked((ulong)values[i]));
            }
            return body;
        }

        private void See(uint number)
        {
            if (numbers == 0)
            {
                firstNumber = highest = number;
                numbers = 1;
                states[number % Remembered] = State.Open;
                return;
            }
            int ahead = unchecked((int)(number - highest));
            if (ahead <= 0)
            {
                uint behind = unchecked(highest - number);
                if (behind >= Remembered) return;
                if (behind >= numbers)
                {
                    firstNumber = number;
                    numbers = behind + 1L;
                }
            }
            else
            {
                // What is remembered in their places is too old now.
                for (uint i = 0; i < Math.Min(ahead, Remembered); ++i)
                {
                    states[unchecked(number - i) % Remembered] = State.Unknown;
                }
                highest = number;
                numbers += ahead;
            }
            if (states[number % Remembered] == State.Unknown) states[number % Remembered] = State.Open;
        }

        private static long Percentile(List<long> ages, int percent)
        {
            return ages.Count == 0 ? ControlBody.NoAge : ages[(ages.Count * percent + 99) / 100 - 1];
        }
    }

    /// <summary>What a receiver spends at most: guards against peers that err or attack.</summary>
    public sealed class Limits
    {
        /// <summary>Bytes announced by all open messages; a sender has a quarter.</summary>
        public long MemoryBytes { get; set; } = 64 << 20;

        /// <summary>Messages of a topic of which parts are missing.</summary>
        public int OpenPerTopic { get; set; } = 4;

        /// <summary>Senders that are remembered.</summary>
        public int Senders { get; set; } = 64;

        /// <summary>Topics of all senders that are remembered.</summary>
        public int Topics { get; set; } = 1024;

        /// <summary>From a message's first part to its last.</summary>
        public long TimeLimitNanos { get; set; } = 2 * Wire.Nanos;

        /// <summary>Bytes of the socket's receive buffer, sent in every Credit. On Linux it is what
        /// reading SO_RCVBUF back tells.</summary>
        public uint ReceiveBuffer { get; set; } = 212992;
    }

    /// <summary>What became of all that came.</summary>
    public sealed class Counters
    {
        /// <summary>Datagrams refused, by the reasons of PROTOCOL.md, section 7.</summary>
        public Dictionary<string, long> Refused { get; } = new Dictionary<string, long>();

        /// <summary>Messages handed over.</summary>
        public long Messages { get; internal set; }

        /// <summary>Messages given up before all their parts were in.</summary>
        public long Incomplete { get; internal set; }

        /// <summary>Whole messages that came behind a newer one.</summary>
        public long Late { get; internal set; }

        /// <summary>Gaps in the numbers of messages.</summary>
        public long Missing { get; internal set; }

        /// <summary>Datagrams that had been there before.</summary>
        public long Duplicates { get; internal set; }

        internal void Refuse(string reason)
        {
            long before;
            Refused.TryGetValue(reason, out before);
            Refused[reason] = before + 1;
        }
    }

    /// <summary>Joins the datagrams of any number of senders into messages, and gives Credit for
    /// them. For one thread at a time.</summary>
    public sealed class Receiver
    {
        private const int FinishedRemembered = 64;
        private const int RestartNumbers = 256;
        private const long ReportedNanos = 5 * Wire.Nanos;  // behind a sender's last datagram
        private const int MostAhead = 3000, MostBehind = 100;  // MAX_DROPOUT, MAX_MISORDER
        private const long StaleNanos = 2 * Wire.Nanos;
        private static readonly int[] StampOrdered =
        {
            2, 5, 9, 36, 38,
        };

        private readonly Limits limits;
        private readonly Dictionary<object, Peer> peers = new Dictionary<object, Peer>();
        private readonly HashSet<object> challengers = new HashSet<object>();
        private readonly LinkedList<Open> oldest = new LinkedList<Open>();
        private int topics;
        private long heard;

        /// <summary>Begin with nothing.</summary>
        /// <param name="limits">What to spend at most; null for the usual.</param>
        public Receiver(Limits limits = null)
        {
            this.limits = limits ?? new Limits();
        }

        /// <summary>What became of all that came.</summary>
        public Counters Counters { get; } = new Counters();

        /// <summary>Announced size of all open messages in bytes.</summary>
        public long MemoryBytes { get; private set; }

        /// <summary>Take one datagram; return the message that it completed, or null.</summary>
        /// <param name="data">A buffer with the datagram at its beginning, which may be used again
        /// afterwards.</param>
        /// <param name="size">Bytes of the datagram.</param>
        /// <param name="sender">Who sent it, such as an EndPoint: equal for equal senders.</param>
        /// <param name="nowNanos">A clock that never goes back.</param>
        /// <param name="credit">A datagram to be sent back to the sender, or null: a Credit, or
        /// the answer to an AddressChallenge.</param>
        public Message Receive(byte[] data, int size, object sender, long nowNanos, out byte[] credit)
        {
            credit = null;
            Header header;
            int at;
            string refusal = Header.Parse(data, size, out header, out at);
            if (refusal == null)
            {
                Expire(nowNanos);
                var datagram = new Datagram(header, data, at, size, sender, nowNanos);
                Message message = null;
                refusal = header.Type == MessageType.Control
                    ? Answer(datagram, out credit)
                    : Accept(datagram, out message, out credit);
                if (refusal == null) return message;
            }
            Counters.Refuse(refusal);
            return null;
        }

        /// <summary>Tell the senders that were heard within the last 5 s what became of their
        /// messages: one TopicReport for each topic. Call it once a second, and three times at the
        /// end. A message counts as published when <see cref="Receive"/> returned it.</summary>
        /// <param name="nowNanos">Of the clock of <see cref="Receive"/>.</param>
        /// <param name="wallNanos">The wall clock in nanoseconds since the POSIX epoch.</param>
        /// <param name="send">Called with the sender and a datagram for it.</param>
        public void Report(long nowNanos, long wallNanos, Action<object, byte[]> send)
        {
            Expire(nowNanos);
            foreach (KeyValuePair<object, Peer> peer in peers)
            {
                if (nowNanos - peer.Value.HeardNanos > ReportedNanos) continue;
                foreach (KeyValuePair<TopicName, Topic> row in peer.Value.Topics)
                {
                    Topic topic = row.Value;
                    var header = new Header { Topic = row.Key.Topic, Link = topic.Link };
                    header.SetStamp(wallNanos);
                    byte[] body = topic.Arrivals.Report(
                        (byte)row.Key.Type, topic.Duplicates, nowNanos, wallNanos);
                    send(peer.Key, Control(peer.Value, header, body));
                }
            }
        }

        /// <summary>From now on answer the AddressChallenges of a peer: one that messages are sent
        /// to, Subscribe included (PROTOCOL.md, section 11). Challenges of others are ignored.
        /// </summary>
        public void AnswerChallengesOf(object peer)
        {
            challengers.Add(peer);
        }

        /// <summary>Give up the messages whose time is over; call it now and then while nothing
        /// comes.</summary>
        public void Expire(long nowNanos)
        {
            while (oldest.Count > 0 && oldest.First.Value.SinceNanos <= nowNanos - limits.TimeLimitNanos)
            {
                GiveUp(oldest.First.Value);
            }
        }

        /// <summary>Count every open message as incomplete, as at an end.</summary>
        public void GiveUpAll()
        {
            while (oldest.Count > 0) GiveUp(oldest.First.Value);
        }

        private struct Datagram
        {
            public readonly Header Header;
            public readonly byte[] Data;
            public readonly int At, Size;
            public readonly object Sender;
            public readonly long NowNanos;

            public Datagram(Header header, byte[] data, int at, int size, object sender, long nowNanos)
            {
                Header = header;
                Data = data;
                At = at;
                Size = size;
                Sender = sender;
                NowNanos = nowNanos;
            }

            public int PartSize
            {
                get { return Size - At; }
            }

            public bool IsLast
            {
                get { return Header.PartNumber + 1 == Header.PartsMax; }
            }

            public TopicName Topic
            {
                get { return new TopicName(Header.Type, Header.Topic); }
            }

            public Key Key
            {
                get { return new Key(Header.SeqNumber, Header.StampNanos); }
            }
        }

        private struct Key
        {
            public readonly uint SeqNumber;
            public readonly long StampNanos;

            public Key(uint seqNumber, long stampNanos)
            {
                SeqNumber = seqNumber;
                StampNanos = stampNanos;
            }

            public bool Is(Key other)
            {
                return SeqNumber == other.SeqNumber && StampNanos == other.StampNanos;
            }
        }

        // A message of which parts are missing.
        private sealed class Open
        {
            public Header Header;
            public Key Key;
            public Peer Peer;
            public Topic Topic;
            public LinkedListNode<Open> Place;
            public long SinceNanos, Announced;
            public int Parts, PartSize, LastSize;  // PartSize 0: not known
            public bool[] Came;
            public byte[] Body;  // PartSize * PartsMax bytes, once that is known
            public byte[] Last;  // the last part, where it came before all others
        }

        private sealed class Topic
        {
            public readonly List<Open> Open = new List<Open>();
            public readonly Queue<Key> Finished = new Queue<Key>();
            public bool HasHanded;
            public Key LastHanded;
            public long LastHandedNanos, Heard, Duplicates;
            public string Link = "";  // the one last seen
            public Arrivals Arrivals = new Arrivals();
            public uint? Suspect;  // the last number that jumped, or was of a stale message

            public Open Find(Key key)
            {
                foreach (Open open in Open)
                {
                    if (open.Key.Is(key)) return open;
                }
                return null;
            }

            public bool IsFinished(Key key)
            {
                foreach (Key finished in Finished)
                {
                    if (finished.Is(key)) return true;
                }
                return false;
            }

            public void Finish(Key key)
            {
                if (IsFinished(key)) return;
                Finished.Enqueue(key);
                if (Finished.Count > FinishedRemembered) Finished.Dequeue();
            }

            // Whether a number is too far from the last one to be believed alone (RFC 3550, A.1).
            public bool IsJump(Key key)
            {
                int ahead = AheadBy(key.SeqNumber);
                return ahead >= MostAhead
                    || (ahead < -MostBehind && key.StampNanos <= LastHanded.StampNanos);
            }

            // Whether a message is older than the newest one, where stamps order a topic.
            public bool IsStale(Datagram d)
            {
                if (!HasHanded) return false;
                long olderBy = LastHanded.StampNanos - d.Header.StampNanos;
                return olderBy > 0 && olderBy <= StaleNanos
                    && Array.IndexOf(StampOrdered, (int)d.Header.Type) >= 0;
            }

            public bool IsSecond(uint seqNumber)
            {
                return Suspect.HasValue && seqNumber == unchecked(Suspect.Value + 1);
            }

            public int AheadBy(uint seqNumber)
            {
                return HasHanded ? unchecked((int)(seqNumber - LastHanded.SeqNumber)) : 1;
            }

            public bool IsRestartBySilence(Datagram d)
            {
                return HasHanded && d.Header.SeqNumber < RestartNumbers
                    && d.NowNanos - LastHandedNanos >= Wire.Nanos
                    && AheadBy(d.Header.SeqNumber) <= 0;
            }
        }

        private sealed class Peer
        {
            public readonly Dictionary<TopicName, Topic> Topics = new Dictionary<TopicName, Topic>();
            public long MemoryBytes, UncreditedBytes, Heard, HeardNanos;
            public uint Controls;
        }

        private string Accept(Datagram d, out Message message, out byte[] credit)
        {
            message = null;
            credit = null;
            bool isSingle = d.Header.PartsMax == 1;
            if (!isSingle && d.PartSize == 0) return "part_size";
            if (d.Header.Type == MessageType.Subscribe)
            {
                if (!isSingle) return "parts_max";
                Subscribe ignored;
                string bad = Subscribe.Parse(d.Data, d.At, d.PartSize, out ignored);
                if (bad != null) return bad;
            }
            string refusal = Check(d);
            if (refusal != null) return refusal;
            Peer peer = PeerOf(d);
            Topic topic = TopicOf(peer, d.Topic);
            if (topic.IsRestartBySilence(d)) Forget(topic, long.MaxValue);
            if (topic.IsFinished(d.Key))
            {
                ++Counters.Duplicates;
                ++topic.Duplicates;
                credit = CreditIfDue(peer, d, d.IsLast);
                return null;
            }
            if (topic.IsJump(d.Key) && topic.Find(d.Key) == null)
            {
                if (!topic.IsSecond(d.Header.SeqNumber))
                {
                    bool isNew = topic.Suspect != d.Header.SeqNumber;
                    topic.Suspect = d.Header.SeqNumber;
                    if (isNew) ++Counters.Late;
                    credit = CreditIfDue(peer, d, isNew || d.IsLast);
                    return null;
                }
                Counters.Missing += Math.Max(0, topic.AheadBy(d.Header.SeqNumber) - 1);
                Forget(topic, long.MaxValue);
            }
            topic.Link = d.Header.Link;
            topic.Arrivals.Seen(d.Key.SeqNumber, d.Key.StampNanos);
            if (isSingle)
            {
                var body = new byte[d.PartSize];
                Buffer.BlockCopy(d.Data, d.At, body, 0, body.Length);
                message = Finish(topic, d, body);
                return null;
            }
            Open open = topic.Find(d.Key) ?? Begin(peer, topic, d);
            if (open.Came[d.Header.PartNumber])
            {
                ++Counters.Duplicates;
                ++topic.Duplicates;
                credit = CreditIfDue(peer, d, d.IsLast);
                return null;
            }
            refusal = Place(open, d);
            Announce(open);
            bool isWhole = open.Parts == d.Header.PartsMax;
            if (isWhole)
            {
                Release(open);
                byte[] body = open.Body;
                Array.Resize(ref body, open.PartSize * (d.Header.PartsMax - 1) + open.LastSize);
                message = Finish(topic, d, body);
            }
            else
            {
                KeepBounds(open);
            }
            credit = CreditIfDue(peer, d, isWhole || d.IsLast);
            return refusal;
        }

        // Refuse a part that contradicts its message, before it changes anything.
        private string Check(Datagram d)
        {
            Peer peer;
            Topic topic;
            if (!peers.TryGetValue(d.Sender, out peer)) return null;
            if (!peer.Topics.TryGetValue(d.Topic, out topic)) return null;
            if (topic.IsRestartBySilence(d)) return null;  // nothing stays open
            Open open = topic.Find(d.Key);
            if (open == null) return null;
            if (open.Header.PartsMax != d.Header.PartsMax) return "parts_max";
            if (open.Header.Link != d.Header.Link) return "link";
            if (open.Came[d.Header.PartNumber] || open.PartSize == 0) return null;
            bool fits = d.PartSize == open.PartSize || (d.IsLast && d.PartSize < open.PartSize);
            return fits ? null : "part_size";
        }

        private Open Begin(Peer peer, Topic topic, Datagram d)
        {
            while (topic.Open.Count >= limits.OpenPerTopic) GiveUp(topic.Open[0]);
            var open = new Open
            {
                Header = d.Header,
                Key = d.Key,
                Peer = peer,
                Topic = topic,
                SinceNanos = d.NowNanos,
                Came = new bool[d.Header.PartsMax],
            };
            topic.Open.Add(open);
            open.Place = oldest.AddLast(open);
            return open;
        }

        // Put a part where it belongs; the first one that is not the last fixes the part size.
        // Return why the last part, which had come before, is refused now.
        private static string Place(Open open, Datagram d)
        {
            string refusal = null;
            int last = d.Header.PartsMax - 1;
            open.Came[d.Header.PartNumber] = true;
            ++open.Parts;
            if (d.IsLast) open.LastSize = d.PartSize;
            if (open.PartSize == 0)
            {
                if (d.IsLast)  // kept aside until another one says how large parts are
                {
                    open.Last = new byte[d.PartSize];
                    Buffer.BlockCopy(d.Data, d.At, open.Last, 0, d.PartSize);
                    return null;
                }
                open.PartSize = d.PartSize;
                open.Body = new byte[d.PartSize * d.Header.PartsMax];
                if (open.Last != null && open.LastSize > open.PartSize)
                {
                    open.Came[last] = false;  // a right one may still come
                    --open.Parts;
                    refusal = "part_size";
                }
                else if (open.Last != null)
                {
                    Buffer.BlockCopy(open.Last, 0, open.Body, last * open.PartSize, open.LastSize);
                }
                open.Last = null;
            }
            int at = d.Header.PartNumber * open.PartSize;
            Buffer.BlockCopy(d.Data, d.At, open.Body, at, d.PartSize);
            return refusal;
        }

        private Message Finish(Topic topic, Datagram d, byte[] body)
        {
            topic.Finish(d.Key);
            int ahead = topic.AheadBy(d.Header.SeqNumber);
            if (ahead > 0 && topic.IsStale(d) && !topic.IsSecond(d.Header.SeqNumber))
            {
                topic.Suspect = d.Header.SeqNumber;
                ++Counters.Late;
                topic.Arrivals.Settle(d.Key.SeqNumber, Arrivals.Result.Late);
                return null;
            }
            else if (ahead > 0)
            {
                Counters.Missing += ahead - 1;
            }
            else if (d.Header.StampNanos <= topic.LastHanded.StampNanos)
            {
                ++Counters.Late;
                topic.Arrivals.Settle(d.Key.SeqNumber, Arrivals.Result.Late);
                return null;
            }
            else
            {
                Forget(topic, d.Header.StampNanos);
                topic.Arrivals.Seen(d.Key.SeqNumber, d.Key.StampNanos);
                topic.Finish(d.Key);
            }
            topic.HasHanded = true;
            topic.LastHanded = d.Key;
            topic.LastHandedNanos = d.NowNanos;
            topic.Suspect = null;
            ++Counters.Messages;
            topic.Arrivals.Publish(d.Key.SeqNumber, d.Key.StampNanos, body.Length, d.NowNanos);
            return new Message(d.Header, body);
        }

        // Begin a topic anew, as for a sender never heard of; older open messages go.
        private void Forget(Topic topic, long beforeNanos)
        {
            foreach (Open open in topic.Open.ToArray())
            {
                if (open.Key.StampNanos < beforeNanos) GiveUp(open);
            }
            topic.HasHanded = false;
            topic.Suspect = null;
            topic.Finished.Clear();
            topic.Arrivals = new Arrivals();
        }

        private void Announce(Open open)
        {
            long size = open.PartSize != 0 ? open.PartSize : open.LastSize;
            long more = size * open.Header.PartsMax - open.Announced;
            open.Announced += more;
            open.Peer.MemoryBytes += more;
            MemoryBytes += more;
        }

        private void KeepBounds(Open open)
        {
            Peer peer = open.Peer;
            while (peer.MemoryBytes > limits.MemoryBytes / 4) GiveUpOldest(peer);
            while (MemoryBytes > limits.MemoryBytes)
            {
                // Who holds nothing else to give takes from the one who holds the most.
                bool hasOthers = peer.MemoryBytes > open.Announced;
                GiveUpOldest(hasOthers ? peer : Best(peers.Values, p => p.MemoryBytes));
            }
        }

        private void GiveUpOldest(Peer peer)
        {
            foreach (Open open in oldest)
            {
                if (open.Peer != peer) continue;
                GiveUp(open);
                return;
            }
        }

        private void GiveUp(Open open)
        {
            open.Topic.Finish(open.Key);
            ++Counters.Incomplete;
            open.Topic.Arrivals.Settle(open.Key.SeqNumber, Arrivals.Result.Incomplete);
            Release(open);
        }

        private void Release(Open open)
        {
            open.Peer.MemoryBytes -= open.Announced;
            MemoryBytes -= open.Announced;
            oldest.Remove(open.Place);
            open.Topic.Open.Remove(open);
        }

        private Peer PeerOf(Datagram d)
        {
            Peer peer;
            if (!peers.TryGetValue(d.Sender, out peer))
            {
                if (peers.Count >= limits.Senders)
                {
                    KeyValuePair<object, Peer> silent = Best(peers, p => -p.Value.Heard);
                    while (silent.Value.Topics.Count > 0) ForgetTopic(silent.Value);
                    peers.Remove(silent.Key);
                }
                peers[d.Sender] = peer = new Peer();
            }
            peer.Heard = ++heard;
            peer.HeardNanos = d.NowNanos;
            return peer;
        }

        private Topic TopicOf(Peer peer, TopicName name)
        {
            Topic topic;
            if (!peer.Topics.TryGetValue(name, out topic))
            {
                if (topics >= limits.Topics)
                {
                    // Its own oldest; a newcomer takes from the one who holds the most.
                    bool hasOthers = peer.Topics.Count > 0;
                    ForgetTopic(hasOthers ? peer : Best(peers.Values, p => p.Topics.Count));
                }
                peer.Topics[name] = topic = new Topic();
                ++topics;
            }
            topic.Heard = ++heard;
            return topic;
        }

        private void ForgetTopic(Peer peer)
        {
            KeyValuePair<TopicName, Topic> silent = Best(peer.Topics, t => -t.Value.Heard);
            foreach (Open open in silent.Value.Open.ToArray()) GiveUp(open);
            peer.Topics.Remove(silent.Key);
            --topics;
        }

        private static T Best<T>(IEnumerable<T> all, Func<T, long> measure)
        {
            T best = default(T);
            long most = long.MinValue;
            foreach (T one in all)
            {
                long measured = measure(one);
                if (measured <= most) continue;
                most = measured;
                best = one;
            }
            return best;
        }

        // Of Control CreditRequest asks something of a receiver, and AddressChallenge of a sender.
        private string Answer(Datagram d, out byte[] credit)
        {
            credit = null;
            if (d.Header.PartsMax != 1) return d.PartSize == 0 ? "part_size" : "parts_max";
            string refusal = ControlBody.Check(d.Data, d.At, d.PartSize);
            if (refusal != null) return refusal;
            byte kind = d.Data[d.At];
            if (kind == ControlBody.CreditRequest) credit = Credit(PeerOf(d), d.Header);
            if (kind == ControlBody.AddressChallenge && challengers.Contains(d.Sender))
            {
                var response = new byte[d.PartSize];
                Buffer.BlockCopy(d.Data, d.At, response, 0, response.Length);
                response[0] = ControlBody.AddressResponse;
                credit = Control(PeerOf(d), new Header { Topic = "", Link = "" }, response);
            }
            return null;
        }

        // Acknowledge a datagram where that is due, or an eighth of the buffer was taken since the
        // last. Kernels round small buffers up.
        private byte[] CreditIfDue(Peer peer, Datagram d, bool isDue)
        {
            if (d.Header.PartsMax == 1) return null;
            peer.UncreditedBytes += d.Size + 1024 + (d.Size <= 16384 ? d.Size : 0);
            bool isMuch = peer.UncreditedBytes > limits.ReceiveBuffer / 8;
            return isDue || isMuch ? Credit(peer, d.Header) : null;
        }

        private byte[] Credit(Peer peer, Header of)
        {
            peer.UncreditedBytes = 0;
            var body = new byte[ControlBody.CreditSize];
            body[1] = (byte)of.Type;
            body[2] = of.PartNumber;
            Wire.WriteU32(body, 4, of.SeqNumber);
            Wire.WriteU32(body, 8, limits.ReceiveBuffer);
            of.Link = "";
            return Control(peer, of, body);
        }

        // Return a datagram to a peer, with topic, link and stamp of a header.
        private static byte[] Control(Peer peer, Header header, byte[] body)
        {
            header.Type = MessageType.Control;
            header.SeqNumber = unchecked(peer.Controls++);
            header.PartNumber = 0;
            header.PartsMax = 1;
            var datagram = new byte[256 + body.Length];
            int at = header.Pack(datagram);
            body.CopyTo(datagram, at);
            Array.Resize(ref datagram, at + body.Length);
            return datagram;
        }
    }

    /// <summary>Cuts messages into datagrams and numbers them. For one thread at a time.</summary>
    public sealed class Sender
    {
        private readonly Dictionary<TopicName, uint> numbers = new Dictionary<TopicName, uint>();
        private readonly byte[] datagram = new byte[Wire.LargestDatagram];

        /// <summary>Send one message.</summary>
        /// <param name="type">What the body is.</param>
        /// <param name="topic">ROS topic name; empty stands for the type's default topic.</param>
        /// <param name="link">Frame of the data; empty where there is none.</param>
        /// <param name="stampNanos">The instant of measurement, since the POSIX epoch.</param>
        /// <param name="body">CDR for types that ROS has, at the beginning of this buffer.</param>
        /// <param name="bodySize">Bytes of the body.</param>
        /// <param name="largest">Bytes of the largest datagram, 256 to 65 507, or a preset of
        /// <see cref="Wire"/>. A message that needs more than 255 parts is cut into larger ones, as
        /// PROTOCOL.md, section 3, has it.</param>
        /// <param name="emit">Called for each datagram, in order, with a buffer that is used again,
        /// and how many of its bytes to send.</param>
        /// <returns>False where the message can't be sent; nothing was sent then.</returns>
        public bool Send(MessageType type, string topic, string link, long stampNanos, byte[] body,
                         int bodySize, int largest, Action<byte[], int> emit)
        {
            var header = new Header { Type = type, PartsMax = 1, Topic = topic, Link = link };
            if (!header.SetStamp(stampNanos)) return false;
            int headerSize = header.Pack(datagram);
            if (headerSize == 0) return false;
            int partSize = PartSize(bodySize, headerSize, largest);
            if (partSize == 0) return false;
            int parts = Math.Max(1, (bodySize + partSize - 1) / partSize);
            var name = new TopicName(type, topic);
            uint number;
            numbers.TryGetValue(name, out number);
            numbers[name] = unchecked(number + 1);
            header.PartsMax = (byte)parts;
            header.SeqNumber = number;
            for (int part = 0; part < parts; ++part)
            {
                header.PartNumber = (byte)part;
                header.Pack(datagram);
                int size = Math.Min(partSize, bodySize - part * partSize);
                Buffer.BlockCopy(body, part * partSize, datagram, headerSize, size);
                emit(datagram, headerSize + size);
            }
            return true;
        }

        /// <summary>Return how many bytes of a body a part carries; 0 where the message fits at no
        /// size.</summary>
        public static int PartSize(int bodySize, int headerSize, int largest)
        {
            bool isSize = largest >= 256 && largest <= Wire.LargestDatagram;
            if (largest != Wire.Loopback && !isSize) return 0;
            int most = Wire.LargestDatagram - headerSize;
            int wanted = isSize ? largest - headerSize : Math.Min(Wire.LoopbackPart, most);
            if (bodySize <= wanted * Wire.MostParts) return wanted;
            for (int size = Wire.Mtu; size < Wire.LargestDatagram; size += 1480)
            {
                if (bodySize <= (size - headerSize) * Wire.MostParts) return size - headerSize;
            }
            return bodySize <= most * Wire.MostParts ? most : 0;
        }
    }

    // Identity of a topic, besides its sender.
    internal struct TopicName : IEquatable<TopicName>
    {
        public readonly MessageType Type;
        public readonly string Topic;

        public TopicName(MessageType type, string topic)
        {
            Type = type;
            Topic = topic;
        }

        public bool Equals(TopicName other)
        {
            return Type == other.Type && Topic == other.Topic;
        }

        public override bool Equals(object other)
        {
            return other is TopicName && Equals((TopicName)other);
        }

        public override int GetHashCode()
        {
            return unchecked(Topic.GetHashCode() * 31 + (int)Type);
        }
    }
}
