// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>builtin_interfaces/msg/Time: an instant since the POSIX epoch.</summary>
    public struct Time
    {
        /// <summary>Seconds, rounded down.</summary>
        public int Sec;

        /// <summary>Nanoseconds of that second.</summary>
        public uint Nanosec;

        /// <summary>Nanoseconds since the POSIX epoch.</summary>
        public long Nanos
        {
            get { return Sec * Wire.Nanos + Nanosec; }
        }

        /// <summary>Return the instant so many nanoseconds after the POSIX epoch; it must be
        /// before 2038.</summary>
        public static Time FromNanos(long nanos)
        {
            long nanosec = (nanos % Wire.Nanos + Wire.Nanos) % Wire.Nanos;
            return new Time
            {
                Sec = checked((int)((nanos - nanosec) / Wire.Nanos)),
                Nanosec = (uint)nanosec,
            };
        }

        internal void Write(CdrWriter to)
        {
            to.Write(Sec);
            to.Write(Nanosec);
        }

        internal void Read(CdrReader from)
        {
            Sec = from.ReadInt32();
            Nanosec = from.ReadUInt32();
        }
    }
}
