// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;

namespace UdpBridge
{
    // What was sent of one topic, and what the receiver reported of it. A restarted receiver counts
    // from zero again; its counts are added to those before.
    internal sealed class TopicCounter
    {
        private const long SettledNanos = 4 * Wire.Nanos;  // never reported since then: missing
        private const long MarkNanos = Wire.Nanos / 4;
        private const long ReorderedNanos = 5 * Wire.Nanos;  // older by more: the clock was set

        private readonly Queue<Mark> marks = new Queue<Mark>();
        private readonly long[] before = new long[5];  // of receivers that were restarted
        private long sent, sentBytes, superseded, oldestStampNanos, reportedNanos, markedNanos;
        private long end;  // lower numbers were reported
        private long settled;  // lower numbers were sent long ago
        private TopicReport report;

        internal TopicCounter(long stampNanos)
        {
            oldestStampNanos = stampNanos;
        }

        // Count a message; return its number.
        internal uint Send(long stampNanos, int bytes)
        {
            oldestStampNanos = Math.Min(oldestStampNanos, stampNanos);
            sentBytes += bytes;
            return unchecked((uint)sent++);
        }

        internal void Supersede()
        {
            ++superseded;
        }

        internal void Take(TopicReport newest, long wallNanos)
        {
            long olderBy = reportedNanos - wallNanos;
            if (sent == 0 || (olderBy > 0 && olderBy <= ReorderedNanos)) return;
            long last = sent - 1, first = last - unchecked((uint)(last - newest.FirstNumber));
            bool isOwn = first >= 0 && newest.Numbers <= (ulong)(sent - first);
            // Others are about an earlier sender at this address.
            if (!isOwn || newest.FirstSeenStampNanos < oldestStampNanos) return;
            if (report != null && newest.SinceNanos != report.SinceNanos) Add(report, before);
            report = newest;
            reportedNanos = wallNanos;
            end = Math.Max(end, first + (long)newest.Numbers);
        }

        // Without isSettled what was not reported is in flight.
        internal DeliveryCounts Counts(TopicName topic, long nowNanos, bool isSettled)
        {
            Settle(nowNanos);
            var sums = (long[])before.Clone();
            if (report != null) Add(report, sums);
            long inFlight = (report == null ? 0 : (long)report.Pending)
                + Math.Max(0, sent - Math.Max(end, isSettled ? settled : 0));
            long counted = inFlight;
            for (int i = 0; i < 4; ++i) counted += sums[i];
            // What a receiver gave up at its end, the next one may have completed.
            long excess = Math.Max(0, counted - sent);
            for (int i = 0; i < 4; ++i)
            {
                long taken = Math.Min(excess, sums[i]);
                sums[i] -= taken;
                counted -= taken;
                excess -= taken;
            }
            return new DeliveryCounts
            {
                Type = topic.Type,
                Topic = topic.Topic,
                Sent = sent,
                SentBytes = sentBytes,
                Superseded = superseded,
                Incomplete = sums[0],
                Late = sums[1],
                Dropped = sums[2],
                Delivered = sums[3],
                Missing = sent - counted,
                InFlight = inFlight,
                DeliveredBytes = sums[4],
                Report = report,
            };
        }

        // In the order in which an excess is taken from them.
        private static void Add(TopicReport report, long[] to)
        {
            unchecked
            {
                to[0] += (long)report.Incomplete;
                to[1] += (long)report.Late;
                to[2] += (long)report.Dropped;
                to[3] += (long)report.Published;
                to[4] += (long)report.BodyBytes;
            }
        }

        private void Settle(long nowNanos)
        {
            if (marks.Count == 0 || nowNanos - markedNanos >= MarkNanos)
            {
                marks.Enqueue(new Mark { Nanos = nowNanos, Sent = sent });
                markedNanos = nowNanos;
            }
            while (marks.Count > 0 && nowNanos - marks.Peek().Nanos >= SettledNanos)
            {
                settled = marks.Dequeue().Sent;
            }
        }

        private struct Mark
        {
            internal long Nanos, Sent;
        }
    }
}
