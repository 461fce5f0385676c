using System;
using System.IO;
using System.Threading;
using Hemilux;

/// <summary>The sources of the Unity package that use nothing of Unity: unity.exe SET.json ADDRESS.</summary>
static class Check
{
    static int failures;

    static void That(bool holds, string text)
    {
        if (holds) return;
        failures++;
        Console.Error.WriteLine("unity.cs: " + text);
    }

    static int Main(string[] arguments)
    {
        Parser(File.ReadAllText(arguments[0]));
        Refusals();
        Harmonics();
        Stream(arguments[1]);
        return failures == 0 ? 0 : 1;
    }

    static void Parser(string json)
    {
        var set = LightSet.Parse(json);
        That(set.Coordinates == "unity" && set.Lights.Length > 0 && set.AmbientSh.Length == 9, "a set of the probe");
        foreach (var light in set.Lights)
        {
            var d = light.Direction;
            That(Math.Abs(Math.Sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) - 1) < 1e-3, "a unit vector");
            // The built-in room is above the horizon: in Unity's axes that is +Y.
            That(d[1] > -1e-3, "a light of the upper hemisphere has y >= 0");
        }
    }

    static void Refusals()
    {
        foreach (var text in new[] { "", "[1,2", "{\"a\":}", "nul", "{\"run\":1}", "\"\\u12\"", new string('[', 100), "1 2", "{}" })
        {
            try
            {
                LightSet.Parse(text);
                That(false, "taken: " + text);
            }
            catch (FormatException error)
            {
                That(error.Message.IndexOf('\n') < 0, "more than one line: " + error.Message);
            }
        }
        That((string)Json.Parse("\"\\u0041\\n\\\"\"") == "A\n\"", "escapes");
    }

    /// <summary>Under the constant radiance 1 every surface receives pi.</summary>
    static void Harmonics()
    {
        var rows = new float[9][];
        for (var i = 0; i < 9; i++) rows[i] = new float[3];
        rows[0] = new[] { 1 / 0.28209479f, 0, 0 };
        var found = new LightSet { AmbientSh = rows }.AmbientIrradiance(0, 1, 0);
        That(Math.Abs(found[0] - Math.PI) < 1e-5 && found[1] == 0, "the irradiance of a constant radiance");
    }

    static void Stream(string address)
    {
        long last = -1;
        using (var events = new Events(address, 3, true))
        {
            for (var frames = 0; frames < 5;)
            {
                var set = events.Take();
                if (set == null)
                {
                    Thread.Sleep(5);
                    continue;
                }
                That(set.Frame > last && set.Lights.Length <= 3, "frames rise");
                last = set.Frame;
                frames++;
            }
            That(events.State == "live", events.State);
        }
        using (var events = new Events("http://127.0.0.1:9", 3, false))
        {
            Thread.Sleep(1000);
            That(events.State.StartsWith("lost: 127.0.0.1:9") && events.State.IndexOf('\n') < 0, events.State);
        }
    }
}
