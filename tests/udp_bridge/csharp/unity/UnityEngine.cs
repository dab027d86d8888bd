// SPDX-License-Identifier: Apache-2.0
// As much of Unity's API as the components call, and `Engine`, which plays its loop. The scene is a
// floor at y = 0 and a wall at z = 10.

using System;
using System.Collections.Generic;
using System.Reflection;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;

        public Vector3(float x, float y, float z)
        {
            this.x = x;
            this.y = y;
            this.z = z;
        }

        public static Vector3 operator -(Vector3 v)
        {
            return new Vector3(-v.x, -v.y, -v.z);
        }

        public static Vector3 operator +(Vector3 a, Vector3 b)
        {
            return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z);
        }

        public static Vector3 operator *(Vector3 v, float by)
        {
            return new Vector3(v.x * by, v.y * by, v.z * by);
        }

        public static float Dot(Vector3 a, Vector3 b)
        {
            return a.x * b.x + a.y * b.y + a.z * b.z;
        }
    }

    public struct Quaternion
    {
        public float x, y, z, w;

        public Quaternion(float x, float y, float z, float w)
        {
            this.x = x;
            this.y = y;
            this.z = z;
            this.w = w;
        }

        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                                  a.w * b.y + a.y * b.w + a.z * b.x - a.x * b.z,
                                  a.w * b.z + a.z * b.w + a.x * b.y - a.y * b.x,
                                  a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }

        // About z, then x, then y.
        public static Quaternion Euler(Vector3 degrees)
        {
            return About(1, degrees.y) * About(0, degrees.x) * About(2, degrees.z);
        }

        private static Quaternion About(int axis, double degrees)
        {
            double half = degrees * Math.PI / 360;
            float sine = (float)Math.Sin(half), cosine = (float)Math.Cos(half);
            return new Quaternion(axis == 0 ? sine : 0, axis == 1 ? sine : 0, axis == 2 ? sine : 0,
                                  cosine);
        }

        // As Unity turns a vector.
        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            float tx = 2 * (q.y * v.z - q.z * v.y);
            float ty = 2 * (q.z * v.x - q.x * v.z);
            float tz = 2 * (q.x * v.y - q.y * v.x);
            return new Vector3(v.x + q.w * tx + q.y * tz - q.z * ty,
                               v.y + q.w * ty + q.z * tx - q.x * tz,
                               v.z + q.w * tz + q.x * ty - q.y * tx);
        }
    }

    public static class Mathf
    {
        public const float Rad2Deg = 57.29578f;

        public static float Abs(float f)
        {
            return Math.Abs(f);
        }
    }

    public struct Rect
    {
        public Rect(float x, float y, float width, float height)
        {
        }
    }

    public struct LayerMask
    {
        private int bits;

        public static implicit operator int(LayerMask mask)
        {
            return mask.bits;
        }

        public static implicit operator LayerMask(int bits)
        {
            return new LayerMask { bits = bits };
        }
    }

    public struct RaycastHit
    {
        public float distance { get; set; }
        public Vector3 normal { get; set; }
    }

    public static class Physics
    {
        public const int DefaultRaycastLayers = ~4;

        public static bool Raycast(Vector3 origin, Vector3 direction, out RaycastHit hit,
                                   float maxDistance, int layerMask)
        {
            float floor = direction.y < 0 ? -origin.y / direction.y : float.PositiveInfinity;
            float wall = direction.z > 0 ? (10 - origin.z) / direction.z : float.PositiveInfinity;
            hit = new RaycastHit
            {
                distance = Math.Min(floor, wall),
                normal = floor < wall ? new Vector3(0, 1, 0) : new Vector3(0, 0, -1),
            };
            return hit.distance <= maxDistance;
        }
    }

    public static class Time
    {
        public static double timeAsDouble { get; set; }
        public static double fixedTimeAsDouble { get; set; }

        public static float fixedDeltaTime
        {
            get { return 0.02f; }
        }
    }

    public static class Application
    {
        public static bool runInBackground { get; set; }
    }

    public class Object
    {
        public static void Destroy(Object obj)
        {
        }
    }

    public sealed class Transform
    {
        public Vector3 position { get; set; }
        public Quaternion rotation { get; set; } = new Quaternion(0, 0, 0, 1);

        public Vector3 TransformDirection(Vector3 direction)
        {
            return rotation * direction;
        }
    }

    public class Component : Object
    {
        internal GameObject Owner;

        public Transform transform
        {
            get { return Owner.transform; }
        }

        public T GetComponent<T>() where T : Component
        {
            return (T)Owner.Components.Find(one => one is T);
        }
    }

    public sealed class Rigidbody : Component
    {
        public Vector3 position { get; private set; }
        public Quaternion rotation { get; private set; } = new Quaternion(0, 0, 0, 1);

        public void MovePosition(Vector3 to)
        {
            position = to;
        }

        public void MoveRotation(Quaternion to)
        {
            rotation = to;
        }
    }

    public class Behaviour : Component
    {
        public bool enabled { get; set; } = true;
    }

    public class MonoBehaviour : Behaviour
    {
    }

    public sealed class GameObject : Object
    {
        internal readonly List<Component> Components = new List<Component>();

        public Transform transform { get; } = new Transform();

        public T AddComponent<T>() where T : Component, new()
        {
            var added = new T { Owner = this };
            Components.Add(added);
            return added;
        }
    }

    public sealed class Camera : Behaviour
    {
        public RenderTexture targetTexture { get; set; }

        public void Render()
        {
            if (enabled) throw new InvalidOperationException("Unity renders it, too");
            ++targetTexture.Rendered;
        }
    }

    public enum TextureFormat
    {
        RGB24 = 3,
    }

    public class Texture : Object
    {
        public int width, height;
    }

    public sealed class RenderTexture : Texture
    {
        internal int Rendered;

        public RenderTexture(int width, int height, int depth)
        {
            this.width = width;
            this.height = height;
        }

        public static RenderTexture active { get; set; }

        public void Release()
        {
        }
    }

    public sealed class Texture2D : Texture
    {
        internal int Rendered;

        public Texture2D(int width, int height, TextureFormat format, bool mipChain)
        {
            this.width = width;
            this.height = height;
        }

        public void ReadPixels(Rect source, int x, int y)
        {
            Rendered = RenderTexture.active.Rendered;
        }
    }

    public static class ImageConversion
    {
        // Width, height, quality and number of the image stand for a JPEG of 100 kB.
        public static byte[] EncodeToJPG(this Texture2D texture, int quality)
        {
            var file = new byte[100000];
            var words = new[] { texture.width, texture.height, quality, texture.Rendered };
            Buffer.BlockCopy(words, 0, file, 0, 16);
            return file;
        }
    }

    public sealed class TooltipAttribute : Attribute
    {
        public TooltipAttribute(string tooltip)
        {
        }
    }

    public sealed class AddComponentMenu : Attribute
    {
        public AddComponentMenu(string menuName)
        {
        }
    }

    public sealed class RequireComponent : Attribute
    {
        public RequireComponent(Type type)
        {
        }

        public RequireComponent(Type type, Type other)
        {
        }
    }

    public sealed class DefaultExecutionOrder : Attribute
    {
        public DefaultExecutionOrder(int order)
        {
        }
    }

    // Unity's loop, in the order of its manual, with a fixed time step of 20 ms.
    public sealed class Engine
    {
        private readonly List<MonoBehaviour> all = new List<MonoBehaviour>();

        public void Begin(params MonoBehaviour[] behaviours)
        {
            all.AddRange(behaviours);
            foreach (MonoBehaviour one in all)
            {
                Call(one, "Awake");
                Call(one, "OnEnable");
            }
            Call("Start");
        }

        public void Frame(double seconds)
        {
            double until = Time.timeAsDouble + seconds;
            for (; Time.fixedTimeAsDouble + 0.02 <= until; Call("FixedUpdate"))
            {
                Time.fixedTimeAsDouble += 0.02;
            }
            Time.timeAsDouble = until;
            Call("Update");
            Call("LateUpdate");
        }

        public void End()
        {
            all.Reverse();
            Call("OnDisable");
            Call("OnDestroy");
        }

        private void Call(string name)
        {
            foreach (MonoBehaviour one in all) Call(one, name);
        }

        private static void Call(MonoBehaviour one, string name)
        {
            const BindingFlags Own = BindingFlags.Instance | BindingFlags.NonPublic;
            MethodInfo method = one.GetType().GetMethod(name, Own);
            if (method != null) method.Invoke(one, null);
        }
    }
}
