// SPDX-License-Identifier: Apache-2.0

using System;
using System.Net;
using UnityEngine;
using Ros = UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Connects a scene to a ROS node. Sensors and receivers refer to it. It stamps their
    /// messages with Unity's time, which begins at the wall clock, and publishes that on /clock.
    /// </summary>
    [DefaultExecutionOrder(-100)]  // the link is there when other components awake
    [AddComponentMenu("UDP Bridge/Bridge Connection")]
    public sealed class BridgeConnection : MonoBehaviour
    {
        /// <summary>Host of the ROS node.</summary>
        [Tooltip("Name or IPv4 address of the host of the ROS node")]
        public string host = "127.0.0.1";

        /// <summary>Port of the ROS node, its parameter bind.</summary>
        [Tooltip("Port of the ROS node: its parameter bind")]
        public int port = 7511;

        /// <summary>Port to receive at, in the node's parameter peer.</summary>
        [Tooltip("Port to receive at: that of the node's parameter peer")]
        public int ownPort = 7510;

        private long startNanos;

        /// <summary>Called in Update with each message that arrived.</summary>
        public event Action<Message> MessageReceived;

        /// <summary>The link; null before Awake.</summary>
        public Link Link { get; private set; }

        /// <summary>Return the stamp of an instant of Unity's time, such as
        /// Time.timeAsDouble.</summary>
        public long StampNanos(double seconds)
        {
            return startNanos + (long)(seconds * 1e9);
        }

        private void Awake()
        {
            Application.runInBackground = true;
            startNanos = Link.WallNanos - (long)(Time.timeAsDouble * 1e9);
            IPAddress address = Array.Find(Dns.GetHostAddresses(host), IsIPv4);
            if (address == null) throw new ArgumentException("no IPv4 address of host " + host);
            bool isThisHost = IPAddress.IsLoopback(address);
            var own = new IPEndPoint(isThisHost ? IPAddress.Loopback : IPAddress.Any, ownPort);
            Link = new Link(own, new IPEndPoint(address, port),
                            isThisHost ? Wire.Loopback : Wire.Mtu);
        }

        private void Update()
        {
            long stampNanos = StampNanos(Time.timeAsDouble);
            var clock = new Ros.Clock { Value = Ros.Time.FromNanos(stampNanos) };
            Link.Send("/clock", clock, stampNanos);
            Message message;
            while (Link.TryReceive(out message)) MessageReceived?.Invoke(message);
        }

        private void OnDestroy()
        {
            Link?.Dispose();  // null where the port was taken
        }

        private static bool IsIPv4(IPAddress address)
        {
            return address.AddressFamily == System.Net.Sockets.AddressFamily.InterNetwork;
        }
    }
}
