// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge
{
    // Limits the mean rate and the burst towards a peer that sends no Credits, PROTOCOL.md,
    // section 8. Bytes are those that the kernel accounts.
    internal sealed class TokenBucket
    {
        private const double RateBytesPerSecond = 50e6;
        private const int BurstBytes = 133120;  // two of the largest datagrams

        private double tokens = BurstBytes;
        private long? filledNanos;

        internal void Sent(long bytes, long nowNanos)
        {
            Fill(nowNanos);
            tokens -= bytes;
        }

        internal bool MaySend(long bytes, long nowNanos)
        {
            Fill(nowNanos);
            return tokens >= Math.Min(bytes, BurstBytes);
        }

        // Return when the bucket holds enough for so many bytes.
        internal long NextWake(long bytes, long nowNanos)
        {
            Fill(nowNanos);
            double wanted = Math.Min(bytes, BurstBytes) - tokens;
            return nowNanos + Math.Max(0, (long)(wanted / RateBytesPerSecond * Wire.Nanos) + 1);
        }

        private void Fill(long nowNanos)
        {
            if (filledNanos.HasValue)
            {
                double gained = (nowNanos - filledNanos.Value) * RateBytesPerSecond / Wire.Nanos;
                tokens = Math.Min(BurstBytes, tokens + gained);
            }
            filledNanos = nowNanos;
        }
    }
}
