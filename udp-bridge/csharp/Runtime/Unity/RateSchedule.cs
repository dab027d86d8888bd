// SPDX-License-Identifier: Apache-2.0

using System;

namespace UdpBridge.Unity
{
    /// <summary>Says when something that happens at a rate is due: at the first call, and at multiples
    /// of its period from then on. What was missed is left out.</summary>
    public sealed class RateSchedule
    {
        private const double Rounding = 1e-6;  // of sums of frame times, in seconds

        private readonly double periodSeconds;
        private double? startSeconds;
        private double dueSeconds;

        /// <summary>Begin at the first call.</summary>
        public RateSchedule(double rateHz)
        {
            periodSeconds = 1 / rateHz;
        }

        /// <summary>Return whether it is due, once for each period.</summary>
        public bool IsDue(double nowSeconds)
        {
            startSeconds = startSeconds ?? nowSeconds;
            double sinceStart = nowSeconds - startSeconds.Value + Rounding;
            if (sinceStart < dueSeconds) return false;
            dueSeconds = (Math.Floor(sinceStart / periodSeconds) + 1) * periodSeconds;
            return true;
        }
    }
}
