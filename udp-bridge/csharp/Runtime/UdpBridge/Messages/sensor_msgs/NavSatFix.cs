// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/NavSatFix.</summary>
    public sealed class NavSatFix : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.NavSatFix; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>Whether there is a fix.</summary>
        public NavSatStatus Status;

        /// <summary>In degrees, north positive.</summary>
        public double Latitude;

        /// <summary>In degrees, east positive.</summary>
        public double Longitude;

        /// <summary>In m above the WGS 84 ellipsoid.</summary>
        public double Altitude;

        /// <summary>In m^2, east, north, up, row-major.</summary>
        public readonly double[] PositionCovariance = new double[9];

        /// <summary>0 unknown, 1 approximated, 2 diagonal known, 3 known.</summary>
        public byte PositionCovarianceType;

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            Status.Write(to);
            to.Write(Latitude);
            to.Write(Longitude);
            to.Write(Altitude);
            to.WriteFixed(PositionCovariance);
            to.Write(PositionCovarianceType);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Status.Read(from);
            Latitude = from.ReadDouble();
            Longitude = from.ReadDouble();
            Altitude = from.ReadDouble();
            from.ReadDoubles(PositionCovariance);
            PositionCovarianceType = from.ReadByte();
        }
    }
}
