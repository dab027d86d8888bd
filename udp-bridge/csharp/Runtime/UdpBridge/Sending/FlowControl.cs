// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge
{
    // Decides whether a datagram of a message of several parts may be sent now, PROTOCOL.md,
    // section 8. A new peer first gets a CreditRequest, because its Credit says how large its buffer
    // is. A peer that never answers is limited by the token bucket.
    internal sealed class FlowControl
    {
        private const long RequestNanos = 10000000;  // since a full window moved, or a request
        private const long FirstCreditNanos = 50000000;  // for the first Credit of a new peer
        private const long GiveUpNanos = Wire.Nanos;  // for a Credit of one that sent some

        private readonly CreditWindow window = new CreditWindow();
        private readonly TokenBucket bucket = new TokenBucket();
        private bool expectsCredit = true;
        private bool isKnown;  // a Credit came or was requested
        private long timeoutNanos = FirstCreditNanos;
        private long? firstRequestNanos;  // since the newest Credit
        private long lastRequestNanos;

        // Credits that were requested because a full window stood still.
        internal long Stalls { get; private set; }

        internal bool MaySend(int size, long nowNanos)
        {
            if (expectsCredit) return isKnown && window.Fits(size);
            return bucket.MaySend(CreditWindow.KernelBytes(size), nowNanos);
        }

        internal void Sent(TopicName topic, uint seqNumber, int part, int size, long nowNanos)
        {
            window.Sent(topic, seqNumber, part, size, nowNanos);
            if (!expectsCredit) bucket.Sent(CreditWindow.KernelBytes(size), nowNanos);
        }

        // Return whether to request a Credit now; Requested must follow. After too many requests in
        // vain the token bucket takes over.
        internal bool IsRequestDue(int size, long nowNanos)
        {
            if (!expectsCredit || nowNanos < NextRequestNanos(size)) return false;
            bool isInVain = firstRequestNanos.HasValue
                && nowNanos - firstRequestNanos.Value >= timeoutNanos;
            expectsCredit = !isInVain;
            return expectsCredit;
        }

        internal void Requested(uint seqNumber, int size, long nowNanos)
        {
            if (isKnown) ++Stalls;
            isKnown = true;
            lastRequestNanos = nowNanos;
            firstRequestNanos = firstRequestNanos ?? nowNanos;
            Sent(new TopicName(MessageType.Control, ""), seqNumber, 0, size, nowNanos);
        }

        internal void Credited(TopicName topic, uint seqNumber, int part, uint receiveBuffer,
                               long nowNanos)
        {
            if (!window.Acknowledge(topic, seqNumber, part, receiveBuffer, nowNanos)) return;
            expectsCredit = isKnown = true;
            timeoutNanos = GiveUpNanos;
            firstRequestNanos = null;
        }

        // Return when to look again, should no Credit come.
        internal long NextWake(int size, long nowNanos)
        {
            if (!expectsCredit)
            {
                return bucket.NextWake(CreditWindow.KernelBytes(size), nowNanos);
            }
            if (window.Fits(size)) return nowNanos;
            return System.Math.Max(nowNanos, NextRequestNanos(size));
        }

        private long NextRequestNanos(int size)
        {
            if (!isKnown) return long.MinValue;
            if (window.Fits(size)) return long.MaxValue;
            if (!firstRequestNanos.HasValue) return window.MovedNanos + RequestNanos;
            return System.Math.Min(lastRequestNanos + RequestNanos,
                                   firstRequestNanos.Value + timeoutNanos);
        }
    }
}
