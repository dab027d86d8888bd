// SPDX-License-Identifier: Apache-2.0

using System;
using System.Collections.Generic;

namespace UdpBridge
{
    // What a receiver remembers of one topic of one sender.
    internal sealed class ReceivedTopic
    {
        private const int FinishedRemembered = 64;
        private const int RestartNumbers = 256;
        private const int MostAhead = 3000, MostBehind = 100;  // MAX_DROPOUT, MAX_MISORDER
        private const long StaleNanos = 2 * Wire.Nanos;
        private static readonly int[] StampOrdered =
        {
            2, 5, 9, 36, 38,
        };

        public readonly List<OpenMessage> Open = new List<OpenMessage>();
        public readonly Queue<MessageKey> Finished = new Queue<MessageKey>();
        public bool HasHanded;
        public MessageKey LastHanded;
        public long LastHandedNanos, Heard, Duplicates;
        public string Link = "";  // the one last seen
        public DeliveryLog DeliveryLog = new DeliveryLog();
        public uint? Suspect;  // the last number that jumped, or was of a stale message

        public OpenMessage Find(MessageKey key)
        {
            foreach (OpenMessage open in Open)
            {
                if (open.Key.Is(key)) return open;
            }
            return null;
        }

        public bool IsFinished(MessageKey key)
        {
            foreach (MessageKey finished in Finished)
            {
                if (finished.Is(key)) return true;
            }
            return false;
        }

        public void Finish(MessageKey key)
        {
            if (IsFinished(key)) return;
            Finished.Enqueue(key);
            if (Finished.Count > FinishedRemembered) Finished.Dequeue();
        }

        // Whether a number is too far from the last one to be believed alone (RFC 3550, A.1).
        public bool IsJump(MessageKey key)
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
}
