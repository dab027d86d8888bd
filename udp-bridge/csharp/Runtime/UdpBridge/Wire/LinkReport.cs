// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;
using System.Linq;
using System.Text;

namespace UdpBridge
{
    /// <summary>Kind 2 of Control, PROTOCOL.md, section 6: totals of a socket since its start.
    /// </summary>
    public sealed class LinkReport
    {
        private const int FixedSize = 40, ReasonSize = 9, MostReasons = 32;

        /// <summary>Bytes of the receive buffer, as the kernel accounts them.</summary>
        public uint ReceiveBuffer { get; internal set; }

        /// <summary>Datagrams received.</summary>
        public ulong Datagrams { get; internal set; }

        /// <summary>Bytes received, headers included.</summary>
        public ulong Bytes { get; internal set; }

        /// <summary>Datagrams that section 7 forbids.</summary>
        public ulong Refused { get; internal set; }

        /// <summary>Datagrams that the kernel dropped because the receive buffer was full; 0 from
        /// receivers in C#, which can't read it.</summary>
        public ulong KernelDrops { get; internal set; }

        /// <summary>Refused datagrams by reason, the most frequent first.</summary>
        public List<KeyValuePair<string, ulong>> Reasons { get; }
            = new List<KeyValuePair<string, ulong>>();

        // Read a body that ControlBody.Check found valid.
        internal static LinkReport Parse(ArraySegment<byte> body)
        {
            byte[] data = body.Array;
            int at = body.Offset, end = at + body.Count;
            var report = new LinkReport
            {
                ReceiveBuffer = Wire.ReadU32(data, at + 4),
                Datagrams = Wire.ReadU64(data, at + 8),
                Bytes = Wire.ReadU64(data, at + 16),
                Refused = Wire.ReadU64(data, at + 24),
                KernelDrops = Wire.ReadU64(data, at + 32),
            };
            for (at += FixedSize; at < end; at += ReasonSize + data[at + ReasonSize - 1])
            {
                string name = Encoding.ASCII.GetString(data, at + ReasonSize, data[at + 8]);
                report.Reasons.Add(new KeyValuePair<string, ulong>(name, Wire.ReadU64(data, at)));
            }
            return report;
        }

        // Add the reasons, in the order of the report.
        internal void AddReasons(Dictionary<string, long> refused)
        {
            IEnumerable<KeyValuePair<string, long>> ordered = refused
                .OrderByDescending(one => one.Value)
                .ThenBy(one => one.Key, StringComparer.Ordinal);
            foreach (KeyValuePair<string, long> one in ordered.Take(MostReasons))
            {
                Reasons.Add(new KeyValuePair<string, ulong>(one.Key, (ulong)one.Value));
            }
            Refused = (ulong)refused.Values.Sum();
        }

        internal byte[] Pack()
        {
            var body = new byte[FixedSize + Reasons.Sum(one => ReasonSize + one.Key.Length)];
            body[0] = ControlBody.LinkReport;
            Wire.WriteU32(body, 4, ReceiveBuffer);
            Wire.WriteU64(body, 8, Datagrams);
            Wire.WriteU64(body, 16, Bytes);
            Wire.WriteU64(body, 24, Refused);
            Wire.WriteU64(body, 32, KernelDrops);
            int at = FixedSize;
            foreach (KeyValuePair<string, ulong> one in Reasons)
            {
                Wire.WriteU64(body, at, one.Value);
                body[at + 8] = (byte)one.Key.Length;
                Encoding.ASCII.GetBytes(one.Key, 0, one.Key.Length, body, at + ReasonSize);
                at += ReasonSize + one.Key.Length;
            }
            return body;
        }
    }
}
