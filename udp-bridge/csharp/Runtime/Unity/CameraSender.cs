// SPDX-License-Identifier: Apache-2.0

using UnityEngine;
using Ros = UdpBridge.Messages;

namespace UdpBridge.Unity
{
    /// <summary>Sends what a camera of its own sees as JPEG, in CompressedImage.</summary>
    [RequireComponent(typeof(Camera))]
    [AddComponentMenu("UDP Bridge/Camera Sender")]
    public sealed class CameraSender : MonoBehaviour
    {
        /// <summary>Where to send.</summary>
        public BridgeConnection connection;

        /// <summary>ROS topic.</summary>
        public string topic = "/camera/image_raw/compressed";

        /// <summary>Optical frame of the camera: x right, y down, z forward.</summary>
        [Tooltip("Optical frame: x right, y down, z forward")]
        public string frameId = "camera_optical_frame";

        /// <summary>Width of the image in pixels.</summary>
        public int width = 640;

        /// <summary>Height of the image in pixels.</summary>
        public int height = 480;

        /// <summary>Quality of the JPEG, 1..100.</summary>
        public int quality = 85;

        /// <summary>Images of a second of Unity's time, at most the rate of frames.</summary>
        public float rateHz = 10;

        private Camera eye;
        private RenderTexture target;
        private Texture2D pixels;
        private RateSchedule schedule;

        private void Awake()
        {
            target = new RenderTexture(width, height, 24);
            pixels = new Texture2D(width, height, TextureFormat.RGB24, false);
            schedule = new RateSchedule(rateHz);
            eye = GetComponent<Camera>();
            eye.targetTexture = target;
            eye.enabled = false;  // it renders only when an image is due
        }

        // Everything has moved in Update.
        private void LateUpdate()
        {
            if (!schedule.IsDue(Time.timeAsDouble)) return;
            var image = new Ros.CompressedImage { Format = "jpeg", Data = Render() };
            long stampNanos = connection.StampNanos(Time.timeAsDouble);
            image.Header.Stamp = Ros.Time.FromNanos(stampNanos);
            image.Header.FrameId = frameId;
            connection.Link.Send(topic, image);
        }

        private void OnDestroy()
        {
            target.Release();
            Destroy(pixels);
        }

        private byte[] Render()
        {
            eye.Render();
            RenderTexture before = RenderTexture.active;
            RenderTexture.active = target;
            pixels.ReadPixels(new Rect(0, 0, width, height), 0, 0);
            RenderTexture.active = before;
            return pixels.EncodeToJPG(quality);
        }
    }
}
