// SPDX-License-Identifier: Apache-2.0

using System;
using UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Directions and times of the rays of a LiDAR that turns: columns of rings that fire
    /// together. It turns clockwise seen from above and begins at the front; ring 0 is the lowest.
    /// </summary>
    public sealed class ScanPattern
    {
        private readonly double[] elevations;
        private readonly double rateHz;

        /// <summary>Define a pattern.</summary>
        /// <param name="rings">Lasers, one or more, at equal angles from each other.</param>
        /// <param name="lowestDeg">Elevation of ring 0, negative below the horizon.</param>
        /// <param name="highestDeg">Elevation of the last ring.</param>
        /// <param name="columns">Firings of a turn.</param>
        /// <param name="rateHz">Turns of a second.</param>
        public ScanPattern(int rings, double lowestDeg, double highestDeg, int columns, double rateHz)
        {
            elevations = new double[rings];
            for (int ring = 0; ring < rings; ++ring)
            {
                double share = rings > 1 ? ring / (rings - 1.0) : 0;
                elevations[ring] = (lowestDeg + share * (highestDeg - lowestDeg)) * Math.PI / 180;
            }
            Columns = columns;
            this.rateHz = rateHz;
        }

        /// <summary>Lasers.</summary>
        public int Rings
        {
            get { return elevations.Length; }
        }

        /// <summary>Firings of a turn.</summary>
        public int Columns { get; }

        /// <summary>Return the direction of a ray in the sensor's frame, x forward, y left, z up, of
        /// length 1.</summary>
        public Vector3 Direction(int column, int ring)
        {
            double azimuth = 2 * Math.PI * column / Columns, elevation = elevations[ring];
            return new Vector3
            {
                X = Math.Cos(elevation) * Math.Cos(azimuth),
                Y = -Math.Cos(elevation) * Math.Sin(azimuth),
                Z = Math.Sin(elevation),
            };
        }

        /// <summary>Return how many columns have fired so many seconds after the start.</summary>
        public long FiredUntil(double seconds)
        {
            return (long)Math.Floor(seconds * rateHz * Columns + 1e-6) + 1;
        }

        /// <summary>Return when a column fires, in seconds after the start; columns count on over the
        /// turns.</summary>
        public double Time(long column)
        {
            return column / (rateHz * Columns);
        }
    }
}
