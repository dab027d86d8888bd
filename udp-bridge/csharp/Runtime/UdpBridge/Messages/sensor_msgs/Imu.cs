// SPDX-License-Identifier: Apache-2.0

namespace UdpBridge.Messages
{
    /// <summary>sensor_msgs/msg/Imu. Covariances are row-major.</summary>
    public sealed class Imu : IStampedMessage
    {
        /// <inheritdoc/>
        public MessageType Type
        {
            get { return MessageType.Imu; }
        }

        /// <inheritdoc/>
        public Header Header { get; } = new Header();

        /// <summary>World from sensor.</summary>
        public Quaternion Orientation;

        /// <summary>In rad^2; element 0 is -1 where there is no orientation.</summary>
        public readonly double[] OrientationCovariance = new double[9];

        /// <summary>In rad/s.</summary>
        public Vector3 AngularVelocity;

        /// <summary>In (rad/s)^2.</summary>
        public readonly double[] AngularVelocityCovariance = new double[9];

        /// <summary>Specific force in m/s^2.</summary>
        public Vector3 LinearAcceleration;

        /// <summary>In (m/s^2)^2.</summary>
        public readonly double[] LinearAccelerationCovariance = new double[9];

        /// <inheritdoc/>
        public void Write(CdrWriter to)
        {
            Header.Write(to);
            Orientation.Write(to);
            to.WriteFixed(OrientationCovariance);
            AngularVelocity.Write(to);
            to.WriteFixed(AngularVelocityCovariance);
            LinearAcceleration.Write(to);
            to.WriteFixed(LinearAccelerationCovariance);
        }

        /// <inheritdoc/>
        public void Read(CdrReader from)
        {
            Header.Read(from);
            Orientation.Read(from);
            from.ReadDoubles(OrientationCovariance);
            AngularVelocity.Read(from);
            from.ReadDoubles(AngularVelocityCovariance);
            LinearAcceleration.Read(from);
            from.ReadDoubles(LinearAccelerationCovariance);
        }
    }
}
