// SPDX-License-Identifier: Apache-2.0

using System.Collections.Generic;

namespace UdpBridge
{
    // Limits the bytes in the peer's receive buffer: all that was sent after the newest Credit.
    // Consecutive parts of a message are one entry: 1 MB in parts of 1472 bytes would be 700.
    internal sealed class CreditWindow
    {
        private const int DefaultReceiveBuffer = 212992;  // Linux's; assumed until the first Credit
        private const int Share = 2;  // kernels free memory late, so half of a buffer is used
        private const int Tracked = 4096;
        private const int Overhead = 1024, RoundedUpTo = 16384;

        private readonly LinkedList<PartRange> ranges = new LinkedList<PartRange>();
        private int count;

        // Kernel bytes in flight, and most of them.
        internal long InFlightBytes { get; private set; }

        internal long WindowBytes { get; private set; } = DefaultReceiveBuffer / Share;

        // Time of the newest datagram or Credit.
        internal long MovedNanos { get; private set; }

        // Bytes of a receive buffer that a datagram takes: kernels round small buffers up.
        internal static int KernelBytes(int size)
        {
            return size + (size <= RoundedUpTo ? size : 0) + Overhead;
        }

        internal void Sent(TopicName topic, uint seqNumber, int part, int size, long nowNanos)
        {
            int cost = KernelBytes(size);
            PartRange newest = ranges.Count > 0 ? ranges.Last.Value : null;
            bool continues = newest != null && newest.Is(topic, seqNumber)
                && newest.First + newest.Count == part && newest.Cost == newest.LastCost
                && newest.Cost >= cost;
            if (continues)
            {
                ++newest.Count;
                newest.LastCost = cost;
            }
            else
            {
                ranges.AddLast(new PartRange(topic, seqNumber, part, cost));
            }
            InFlightBytes += cost;
            MovedNanos = nowNanos;
            if (++count > Tracked) Pop(1);
        }

        // Apply a Credit: free its datagram and all before it, and set the size of the window.
        // One for a datagram that is not in flight is late or forged: return false.
        internal bool Acknowledge(TopicName topic, uint seqNumber, int part, uint receiveBuffer,
                                  long nowNanos)
        {
            int before = 0;
            foreach (PartRange range in ranges)
            {
                int ahead = part - range.First;
                if (range.Is(topic, seqNumber) && ahead >= 0 && ahead < range.Count)
                {
                    WindowBytes = receiveBuffer / Share;
                    MovedNanos = nowNanos;
                    Pop(before + ahead + 1);
                    return true;
                }
                before += range.Count;
            }
            return false;
        }

        // Whether a datagram of so many bytes fits; one always does when none is in flight.
        internal bool Fits(int size)
        {
            return count == 0 || InFlightBytes + KernelBytes(size) <= WindowBytes;
        }

        private void Pop(int parts)
        {
            count -= parts;
            while (parts > 0)
            {
                PartRange oldest = ranges.First.Value;
                if (parts < oldest.Count)
                {
                    InFlightBytes -= (long)parts * oldest.Cost;
                    oldest.First += parts;
                    oldest.Count -= parts;
                    return;
                }
                InFlightBytes -= (oldest.Count - 1L) * oldest.Cost + oldest.LastCost;
                parts -= oldest.Count;
                ranges.RemoveFirst();
            }
        }

        // Consecutive parts of one message; only the last may be smaller.
        private sealed class PartRange
        {
            internal int First, Count = 1, LastCost;
            internal readonly int Cost;
            private readonly TopicName topic;
            private readonly uint seqNumber;

            internal PartRange(TopicName topic, uint seqNumber, int part, int cost)
            {
                this.topic = topic;
                this.seqNumber = seqNumber;
                First = part;
                Cost = LastCost = cost;
            }

            internal bool Is(TopicName other, uint number)
            {
                return seqNumber == number && topic.Equals(other);
            }
        }
    }
}
