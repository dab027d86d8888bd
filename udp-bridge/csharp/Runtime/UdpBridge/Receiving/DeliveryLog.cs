// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;

namespace UdpBridge
{
    // What became of the messages of one topic until its sender restarts; each gets one result,
    // among the newest 1024.
    internal sealed class DeliveryLog
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

        internal TopicReport Report(MessageType type, long duplicates, long nowNanos, long wallNanos)
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
            return new TopicReport
            {
                Type = type,
                FirstNumber = firstNumber,
                SinceNanos = since.Value,
                Numbers = (ulong)numbers,
                Published = (ulong)counts[(int)Result.Published],
                Incomplete = (ulong)counts[(int)Result.Incomplete],
                Late = (ulong)counts[(int)Result.Late],
                Pending = (ulong)pending,
                Duplicates = (ulong)duplicates,
                BodyBytes = (ulong)bodyBytes,
                FirstSeenStampNanos = firstSeenStamp,
                FirstStampNanos = firstStamp,
                LastStampNanos = lastStamp,
                AgeP50Nanos = Percentile(ages, 50),
                AgeP99Nanos = Percentile(ages, 99),
            };
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
            return ages.Count == 0 ? TopicReport.NoAge : ages[(ages.Count * percent + 99) / 100 - 1];
        }
    }
}
