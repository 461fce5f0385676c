using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Rendering;

namespace Hemilux
{
    /// <summary>Shows the light sets of a probe as directional lights and ambient light. A light keeps its Unity light for as long as it exists.</summary>
    [AddComponentMenu("Rendering/hemilux Lights")]
    public sealed class HemiluxLights : MonoBehaviour
    {
        [Tooltip("Address of the probe, http://HOST:PORT.")]
        public string address = "http://127.0.0.1:8080";
        [Range(1, 32), Tooltip("Largest number of directional lights.")]
        public int lights = 4;
        [Tooltip("Sets the ambient light of the scene from the probe's diffuse light.")]
        public bool ambient = true;
        [Min(0), Tooltip("Factor of all intensities: the probe's units are relative until its camera is calibrated.")]
        public float exposure = 1;
        [Tooltip("Shadows of the lights.")]
        public LightShadows shadows = LightShadows.Soft;

        readonly Dictionary<long, Light> held = new Dictionary<long, Light>();
        readonly List<Light> made = new List<Light>();
        Events events;
        string told, run;

        void OnEnable()
        {
            try
            {
                events = new Events(address, lights, ambient);
            }
            catch (FormatException error)
            {
                Debug.LogError("hemilux: " + error.Message, this);
            }
        }

        void OnDisable()
        {
            if (events != null) events.Dispose();
            events = null;
        }

        void Update()
        {
            if (events == null) return;
            Log(events.State);
            var set = events.Take();
            if (set != null) Show(set);
        }

        void Log(string state)
        {
            if (state == told) return;
            told = state;
            if (state != "live") Debug.LogWarning("hemilux: " + state, this);
        }

        void Show(LightSet set)
        {
            if (set.Run != run) held.Clear();
            run = set.Run;
            var present = new HashSet<long>();
            foreach (var light in set.Lights) present.Add(light.Id);
            foreach (var id in new List<long>(held.Keys)) if (!present.Contains(id)) held.Remove(id);
            foreach (var unused in made) if (!held.ContainsValue(unused)) unused.enabled = false;
            foreach (var light in set.Lights) Shine(Held(light.Id), light);
            if (ambient && set.AmbientSh != null) ShowAmbient(set);
        }

        Light Held(long id)
        {
            Light light;
            if (held.TryGetValue(id, out light)) return light;
            light = made.Find(free => !held.ContainsValue(free)) ?? Made();
            held[id] = light;
            return light;
        }

        Light Made()
        {
            var light = new GameObject("hemilux light").AddComponent<Light>();
            light.transform.SetParent(transform, false);
            light.type = LightType.Directional;
            made.Add(light);
            return light;
        }

        /// <summary>Sets the Unity light to the probe's light. Unity's lights have no factor 1 / pi: a white surface under intensity 1 has the radiance 1.</summary>
        void Shine(Light target, ProbeLight light)
        {
            var top = Mathf.Max(light.Irradiance[0], light.Irradiance[1], light.Irradiance[2]);
            var colour = top > 0 ? new Color(light.Irradiance[0] / top, light.Irradiance[1] / top, light.Irradiance[2] / top) : Color.black;
            target.enabled = top > 0;
            target.color = QualitySettings.activeColorSpace == ColorSpace.Linear ? colour.gamma : colour;
            target.intensity = top * exposure / Mathf.PI;
            target.shadows = shadows;
            target.transform.rotation = Quaternion.LookRotation(-new Vector3(light.Direction[0], light.Direction[1], light.Direction[2]));
        }

        void ShowAmbient(LightSet set)
        {
            RenderSettings.ambientMode = AmbientMode.Trilight;
            RenderSettings.ambientSkyColor = Ambient(set, 0, 1, 0);
            RenderSettings.ambientGroundColor = Ambient(set, 0, -1, 0);
            RenderSettings.ambientEquatorColor = (Ambient(set, 1, 0, 0) + Ambient(set, -1, 0, 0) + Ambient(set, 0, 0, 1) + Ambient(set, 0, 0, -1)) / 4;
        }

        Color Ambient(LightSet set, float x, float y, float z)
        {
            var e = set.AmbientIrradiance(x, y, z);
            return new Color(e[0], e[1], e[2]) * (exposure / Mathf.PI);
        }
    }
}
