// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>geometry_msgs/msg/Quaternion: a rotation, of unit length.</summary>
    public struct Quaternion
    {
        /// <summary>Part x.</summary>
        public double X;

        /// <summary>Part y.</summary>
        public double Y;

        /// <summary>Part z.</summary>
        public double Z;

        /// <summary>Part w.</summary>
        public double W;

        internal void Write(CdrWriter to)
        {
            to.Write(X);
            to.Write(Y);
            to.Write(Z);
            to.Write(W);
        }

        internal void Read(CdrReader from)
        {
            X = from.ReadDouble();
            Y = from.ReadDouble();
            Z = from.ReadDouble();
            W = from.ReadDouble();
        }
    }
}
