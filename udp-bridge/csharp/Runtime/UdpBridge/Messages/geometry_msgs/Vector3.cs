// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>geometry_msgs/msg/Vector3.</summary>
    public struct Vector3
    {
        /// <summary>Along x.</summary>
        public double X;

        /// <summary>Along y.</summary>
        public double Y;

        /// <summary>Along z.</summary>
        public double Z;

        internal void Write(CdrWriter to)
        {
            to.Write(X);
            to.Write(Y);
            to.Write(Z);
        }

        internal void Read(CdrReader from)
        {
            X = from.ReadDouble();
            Y = from.ReadDouble();
            Z = from.ReadDouble();
        }
    }
}
