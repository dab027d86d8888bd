// SPDX-License-Identifier: Apache-2.0

using UnityEngine;
using Ros = UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Sends a cloud for each turn of a LiDAR, in PointCloud2. The rays meet colliders, in
    /// FixedUpdate, from the pose that the sensor has then; a point is in the sensor's frame at that
    /// instant, so motion is not compensated. What nothing returns has no point.</summary>
    [AddComponentMenu("UDP Bridge/Lidar Sender")]
    public sealed class LidarSender : MonoBehaviour
    {
        /// <summary>Where to send.</summary>
        public BridgeConnection connection;

        /// <summary>ROS topic.</summary>
        public string topic = "/points";

        /// <summary>Frame of the sensor: x forward, y left, z up.</summary>
        [Tooltip("Frame of the sensor: x forward, y left, z up")]
        public string frameId = "lidar_link";

        /// <summary>Lasers.</summary>
        public int rings = 16;

        /// <summary>Elevation of the lowest laser.</summary>
        public float lowestDeg = -15;

        /// <summary>Elevation of the highest laser.</summary>
        public float highestDeg = 15;

        /// <summary>Firings of a turn.</summary>
        public int columns = 900;

        /// <summary>Turns of a second of Unity's time.</summary>
        public float rateHz = 10;

        /// <summary>Nearest return in m.</summary>
        public float minRange = 0.4f;

        /// <summary>Farthest return in m.</summary>
        public float maxRange = 100;

        /// <summary>Layers of the colliders that return rays.</summary>
        public LayerMask layers = Physics.DefaultRaycastLayers;

        private readonly CloudBuilder cloud = new CloudBuilder();
        private ScanPattern pattern;
        private double startSeconds;
        private long fired;

        private void Start()
        {
            pattern = new ScanPattern(rings, lowestDeg, highestDeg, columns, rateHz);
            startSeconds = Time.fixedTimeAsDouble;
        }

        private void FixedUpdate()
        {
            long due = pattern.FiredUntil(Time.fixedTimeAsDouble - startSeconds);
            for (; fired < due; ++fired)
            {
                int column = (int)(fired % pattern.Columns);
                if (column == 0 && fired > 0) Send();
                for (int ring = 0; ring < pattern.Rings; ++ring) Cast(column, ring);
            }
        }

        private void Cast(int column, int ring)
        {
            Ros.Vector3 direction = pattern.Direction(column, ring);
            Vector3 inWorld = transform.TransformDirection(RosAxes.ToUnity(direction));
            RaycastHit hit;
            bool isHit = Physics.Raycast(transform.position, inWorld, out hit, maxRange, layers);
            if (!isHit || hit.distance < minRange) return;
            var point = new Ros.Vector3
            {
                X = direction.X * hit.distance,
                Y = direction.Y * hit.distance,
                Z = direction.Z * hit.distance,
            };
            // A white, diffuse surface returns with the cosine of the angle at which it is met.
            float intensity = 100 * Mathf.Abs(Vector3.Dot(hit.normal, inWorld));
            cloud.Add(point, intensity, ring, (float)pattern.Time(column));
        }

        // Send the turn before column `fired`.
        private void Send()
        {
            double beganSeconds = startSeconds + pattern.Time(fired - pattern.Columns);
            connection.Link.Send(topic, cloud.Finish(connection.StampNanos(beganSeconds), frameId));
        }
    }
}
