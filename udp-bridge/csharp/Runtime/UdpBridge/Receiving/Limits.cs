// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
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
}
