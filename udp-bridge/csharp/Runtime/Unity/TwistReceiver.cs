// SPDX-License-Identifier: Apache-2.0

using System;
using UnityEngine;
using Ros = UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Requests velocity commands from the ROS node and hands them over in the axes of ROS.
    /// <see cref="RosAxes"/> converts them.</summary>
    [AddComponentMenu("UDP Bridge/Twist Receiver")]
    public sealed class TwistReceiver : MonoBehaviour
    {
        /// <summary>Where to receive.</summary>
        public BridgeConnection connection;

        /// <summary>ROS topic.</summary>
        public string topic = "/cmd_vel";

        /// <summary>A command holds for so many seconds of Unity's time; then zero follows.</summary>
        [Tooltip("A command holds for so many seconds; then zero follows")]
        public float timeoutSeconds = 0.5f;

        private double untilSeconds = double.PositiveInfinity;

        /// <summary>Called in Update with each command, and with zero when the commands
        /// end.</summary>
        public event Action<Ros.Twist> Received;

        /// <summary>Commands that are no Twist of finite numbers.</summary>
        public long Invalid { get; private set; }

        private void OnEnable()
        {
            connection.MessageReceived += Take;
            connection.Link.Subscribe(MessageType.Twist, topic);
        }

        private void OnDisable()
        {
            connection.MessageReceived -= Take;
        }

        private void Update()
        {
            if (Time.timeAsDouble < untilSeconds) return;
            untilSeconds = double.PositiveInfinity;
            Received?.Invoke(new Ros.Twist());
        }

        private void Take(Message message)
        {
            if (message.Header.Type != MessageType.Twist || message.Header.Topic != topic) return;
            var twist = new Ros.Twist();
            if (!IsRead(message.Body, twist))
            {
                ++Invalid;
                return;
            }
            untilSeconds = Time.timeAsDouble + timeoutSeconds;
            Received?.Invoke(twist);
        }

        private static bool IsRead(byte[] body, Ros.Twist twist)
        {
            try
            {
                Cdr.Decode(body, twist);
            }
            catch (CdrException)
            {
                return false;
            }
            return IsFinite(twist.Linear) && IsFinite(twist.Angular);
        }

        private static bool IsFinite(Ros.Vector3 vector)
        {
            double sum = Math.Abs(vector.X) + Math.Abs(vector.Y) + Math.Abs(vector.Z);
            return !double.IsNaN(sum) && !double.IsInfinity(sum);
        }
    }
}
