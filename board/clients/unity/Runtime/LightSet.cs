using System;
using System.Collections.Generic;

namespace Hemilux
{
    /// <summary>A directional light. Vectors have three elements.</summary>
    public sealed class ProbeLight
    {
        /// <summary>Number of the light, kept from set to set for as long as the light exists.</summary>
        public long Id;
        /// <summary>Unit vector from the probe towards the light.</summary>
        public float[] Direction;
        /// <summary>Perpendicular irradiance, linear red, green and blue.</summary>
        public float[] Irradiance;
        /// <summary>Angular radius of the light as a disc, degrees.</summary>
        public float RadiusDeg;
    }

    /// <summary>The lights of one frame.</summary>
    public sealed class LightSet
    {
        /// <summary>Name of the run, which changes at every start of the probe; ids of different runs are unrelated.</summary>
        public string Run;
        public long Frame;
        /// <summary>Reason why there is no newer set; null for a new one.</summary>
        public string Stale;
        public string Coordinates;
        public ProbeLight[] Lights;
        /// <summary>Ambient light as spherical harmonics, nine rows of red, green and blue; null where they were not requested.</summary>
        public float[][] AmbientSh;

        /// <summary>Parses a light set from the probe's JSON. Throws FormatException with one line for anything else.</summary>
        public static LightSet Parse(string json)
        {
            var root = Json.Parse(json) as Dictionary<string, object>;
            if (root == null) throw new FormatException("light set: expected an object");
            var stale = Member(root, "stale") as Dictionary<string, object>;
            object rows;
            var set = new LightSet
            {
                Run = As<string>(root, "run"),
                Frame = (long)As<double>(root, "frame"),
                Stale = stale == null ? null : As<string>(stale, "reason"),
                Coordinates = As<string>(root, "coordinates"),
                Lights = As<List<object>>(root, "lights").ConvertAll(Light).ToArray(),
                AmbientSh = root.TryGetValue("ambient_sh", out rows) && rows != null ? ((List<object>)rows).ConvertAll(Triple).ToArray() : null,
            };
            if (set.AmbientSh != null && set.AmbientSh.Length != 9) throw new FormatException("light set: expected nine harmonics");
            return set;
        }

        static ProbeLight Light(object value)
        {
            var members = value as Dictionary<string, object>;
            if (members == null) throw new FormatException("light set: expected a light");
            return new ProbeLight
            {
                Id = (long)As<double>(members, "id"),
                Direction = Triple(Member(members, "direction")),
                Irradiance = Triple(Member(members, "irradiance")),
                RadiusDeg = (float)As<double>(members, "radius_deg"),
            };
        }

        static float[] Triple(object value)
        {
            var list = value as List<object>;
            if (list == null || list.Count != 3 || !list.TrueForAll(v => v is double && Math.Abs((double)v) < 1e30))
                throw new FormatException("light set: expected three numbers");
            return list.ConvertAll(v => (float)(double)v).ToArray();
        }

        static object Member(Dictionary<string, object> members, string name)
        {
            object value;
            if (!members.TryGetValue(name, out value)) throw new FormatException("light set: expected the member " + name);
            return value;
        }

        static T As<T>(Dictionary<string, object> members, string name)
        {
            var value = Member(members, name);
            if (value is T) return (T)value;
            throw new FormatException("light set: expected another kind of " + name);
        }

        /// <summary>Returns the irradiance of a surface with the unit normal (x, y, z) under the harmonics (Ramamoorthi and Hanrahan 2001); null without harmonics.</summary>
        public float[] AmbientIrradiance(float x, float y, float z)
        {
            if (AmbientSh == null) return null;
            const double k1 = 0.4886025119, k2 = 1.0925484306, pi = Math.PI;
            double[] basis =
            {
                pi * 0.2820947918, 2 * pi / 3 * k1 * y, 2 * pi / 3 * k1 * z, 2 * pi / 3 * k1 * x,
                pi / 4 * k2 * x * y, pi / 4 * k2 * y * z, pi / 4 * 0.3153915653 * (3 * z * z - 1), pi / 4 * k2 * x * z, pi / 4 * 0.5462742153 * (x * x - y * y),
            };
            var sum = new double[3];
            for (var i = 0; i < 9; i++)
                for (var k = 0; k < 3; k++) sum[k] += basis[i] * AmbientSh[i][k];
            return System.Array.ConvertAll(sum, v => (float)Math.Max(0, v));
        }
    }
}
