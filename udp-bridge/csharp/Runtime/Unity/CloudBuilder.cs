// SPDX-License-Identifier: Apache-2.0

using System;
using UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Collects the points of a cloud. A record has 22 bytes, as in the clouds of Groundlink:
    /// x, y, z in m and intensity as float32, ring as uint16, and time as float32, in seconds since
    /// the cloud's stamp.</summary>
    public sealed class CloudBuilder
    {
        private const int Step = 22, RingOffset = 16, TimeOffset = 18;
        private static readonly string[] Floats = { "x", "y", "z", "intensity" };

        private readonly float[] floats = new float[4];
        private readonly float[] time = new float[1];
        private byte[] data = new byte[Step * 1024];
        private int count;

        /// <summary>Points so far.</summary>
        public int Count
        {
            get { return count; }
        }

        /// <summary>Add a point in the sensor's frame.</summary>
        /// <param name="point">In m.</param>
        /// <param name="intensity">0..100 for diffuse surfaces.</param>
        /// <param name="ring">Number of the laser, from the lowest.</param>
        /// <param name="seconds">Since the cloud's stamp.</param>
        public void Add(Vector3 point, float intensity, int ring, float seconds)
        {
            int at = Step * count++;
            if (at + Step > data.Length) Array.Resize(ref data, 2 * data.Length);
            floats[0] = (float)point.X;
            floats[1] = (float)point.Y;
            floats[2] = (float)point.Z;
            floats[3] = intensity;
            time[0] = seconds;
            // Every platform of Unity is little-endian.
            Buffer.BlockCopy(floats, 0, data, at, RingOffset);
            data[at + RingOffset] = (byte)ring;
            data[at + RingOffset + 1] = (byte)(ring >> 8);
            Buffer.BlockCopy(time, 0, data, at + TimeOffset, 4);
        }

        /// <summary>Return the cloud, and begin the next one.</summary>
        public PointCloud2 Finish(long stampNanos, string frameId)
        {
            var cloud = new PointCloud2
            {
                Height = 1,
                Width = (uint)count,
                Fields = Fields(),
                PointStep = Step,
                RowStep = (uint)(Step * count),
                Data = new byte[Step * count],
                IsDense = true,
            };
            cloud.Header.Stamp = Time.FromNanos(stampNanos);
            cloud.Header.FrameId = frameId;
            Buffer.BlockCopy(data, 0, cloud.Data, 0, cloud.Data.Length);
            count = 0;
            return cloud;
        }

        private static PointField[] Fields()
        {
            var fields = new PointField[Floats.Length + 2];
            for (int i = 0; i < Floats.Length; ++i)
            {
                fields[i] = Field(Floats[i], 4 * i, PointField.Float32);
            }
            fields[Floats.Length] = Field("ring", RingOffset, PointField.UInt16);
            fields[Floats.Length + 1] = Field("time", TimeOffset, PointField.Float32);
            return fields;
        }

        private static PointField Field(string name, int offset, byte datatype)
        {
            return new PointField
            {
                Name = name, Offset = (uint)offset, Datatype = datatype, Count = 1,
            };
        }
    }
}
