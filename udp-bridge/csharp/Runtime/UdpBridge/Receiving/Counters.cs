// SPDX-License-Identifier: Apache-2.0

using System.Collections.Generic;

namespace UdpBridge
{
    /// <summary>What became of all that came.</summary>
    public sealed class Counters
    {
        /// <summary>Datagrams that came, refused ones included.</summary>
        public long Datagrams { get; internal set; }

        /// <summary>Bytes of these datagrams, headers included.</summary>
        public long Bytes { get; internal set; }

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
}
