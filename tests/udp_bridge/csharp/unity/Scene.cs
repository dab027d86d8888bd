// SPDX-License-Identifier: Apache-2.0
// A scene with each component and the Drive of docs/how-to/unity.md, played until a Twist came and the peer has reported a cloud. Its words:
// the peer's port. It prints the axes, each Twist, and what became of the messages.

using System;
using System.Globalization;
using System.Threading;
using UdpBridge;
using UdpBridge.Unity;
using UnityEngine;
using Ros = UdpBridge.Messages;

internal static class Scene
{
    private static void Main(string[] words)
    {
        CultureInfo.CurrentCulture = CultureInfo.InvariantCulture;
        var scene = new GameObject();
        scene.transform.position = new Vector3(0, 1, 0);
        var connection = scene.AddComponent<BridgeConnection>();
        connection.host = "localhost";
        connection.port = int.Parse(words[0]);
        connection.ownPort = 0;
        scene.AddComponent<Camera>();
        var camera = scene.AddComponent<CameraSender>();
        var lidar = scene.AddComponent<LidarSender>();
        var twist = scene.AddComponent<TwistReceiver>();
        var body = scene.AddComponent<Rigidbody>();
        var drive = scene.AddComponent<Drive>();
        camera.connection = lidar.connection = twist.connection = connection;
        lidar.columns = 360;
        int twists = 0;
        twist.Received += command =>
        {
            ++twists;
            Tell("linear", RosAxes.ToUnity(command.Linear));
            Tell("angular", RosAxes.AngularToUnity(command.Angular));
        };
        Axes();
        var engine = new Engine();
        engine.Begin(connection, camera, lidar, twist, drive);
        for (int frame = 0; frame < 4000 && !(twists > 1 && HasReport(connection.Link)); ++frame)
        {
            engine.Frame(1 / 60.0);
            Thread.Sleep(5);
        }
        foreach (DeliveryCounts one in connection.Link.Deliveries())
        {
            long others = one.Dropped + one.Incomplete + one.Late + one.Missing;
            bool isSum = one.Sent == one.Delivered + others + one.InFlight;
            Console.WriteLine("deliveries {0} {1} {2} {3} {4}", one.Topic, one.Sent, one.Delivered,
                              others, isSum);
        }
        Console.WriteLine("peer {0} {1}", connection.Link.PeerReport.Datagrams,
                          connection.Link.PeerReport.Refused);
        Tell("body", body.position);
        Tell("heading", body.rotation * new Vector3(0, 0, 1));
        Console.WriteLine("invalid " + twist.Invalid);
        engine.End();
    }

    private static bool HasReport(Link link)
    {
        DeliveryCounts clouds = link.Deliveries().Find(one => one.Type == MessageType.PointCloud2);
        return clouds != null && clouds.Delivered > 0 && link.PeerReport != null;
    }

    // Where each axis of ROS goes, and whether rotations agree with points.
    private static void Axes()
    {
        for (int axis = 0; axis < 3; ++axis)
        {
            var unit = new Ros.Vector3();
            if (axis == 0) unit.X = 1;
            else if (axis == 1) unit.Y = 1;
            else unit.Z = 1;
            Tell("axis", RosAxes.ToUnity(unit));
            Ros.Vector3 back = RosAxes.ToRos(RosAxes.ToUnity(unit));
            Ros.Vector3 turned = RosAxes.AngularToRos(RosAxes.AngularToUnity(unit));
            Console.WriteLine("same {0} {1}", back.Equals(unit), turned.Equals(unit));
        }
        // A quarter to the left about z of ROS turns what is ahead to the left.
        double half = Math.Sqrt(0.5);
        var left = new Ros.Quaternion { Z = half, W = half };
        Tell("ahead", RosAxes.ToUnity(left) * new Vector3(0, 0, 1));
        Ros.Quaternion again = RosAxes.ToRos(RosAxes.ToUnity(left));
        Console.WriteLine("quaternion {0:F3} {1:F3} {2:F3} {3:F3}", again.X, again.Y, again.Z, again.W);
    }

    private static void Tell(string what, Vector3 unity)
    {
        Console.WriteLine("{0} {1:F3} {2:F3} {3:F3}", what, unity.x, unity.y, unity.z);
    }
}
