using System;
using System.IO;
using System.Net;
using System.Text;
using System.Threading;

namespace Hemilux
{
    /// <summary>Receives the sets of a probe on a thread of its own, and connects again whenever the connection ends.</summary>
    public sealed class Events : IDisposable
    {
        const int Silence = 4000, FirstPause = 250, LongestPause = 8000, LongestEvent = 16 << 20;
        readonly Uri url;
        readonly ManualResetEvent end = new ManualResetEvent(false);
        readonly object guard = new object();
        LightSet newest;
        string state = "connecting";
        volatile HttpWebRequest request;

        /// <summary>Starts the thread. Throws FormatException with one line for an invalid address.</summary>
        public Events(string address, int lights, bool ambient)
        {
            Uri root;
            var isAddress = Uri.TryCreate(address, UriKind.Absolute, out root) && (root.Scheme == "http" || root.Scheme == "https");
            if (!isAddress) throw new FormatException("probe '" + address + "': expected http://HOST:PORT");
            url = new Uri(root, "/v1/events?coordinates=unity&lights=" + lights + "&ambient=" + (ambient ? 1 : 0));
            new Thread(Run) { IsBackground = true, Name = "hemilux" }.Start();
        }

        /// <summary>State of the connection to the probe: "live", "stale: ..." or "lost: ...", one line.</summary>
        public string State { get { lock (guard) return state; } }

        /// <summary>Returns the newest light set once; null where there is no new one.</summary>
        public LightSet Take()
        {
            lock (guard)
            {
                var set = newest;
                newest = null;
                return set;
            }
        }

        public void Dispose()
        {
            end.Set();
            var open = request;
            if (open != null) open.Abort();
        }

        void Run()
        {
            for (var pause = FirstPause; !end.WaitOne(0); pause = Math.Min(LongestPause, 2 * pause))
            {
                try
                {
                    Receive(ref pause);
                    Tell("lost: " + url.Authority + ": the stream ended", null);
                }
                catch (Exception error) when (error is WebException || error is IOException || error is FormatException || error is ObjectDisposedException)
                {
                    Tell("lost: " + url.Authority + ": " + error.Message.Split('\n')[0], null);
                }
                end.WaitOne(pause);
            }
        }

        void Tell(string text, LightSet set)
        {
            lock (guard)
            {
                state = text;
                newest = set ?? newest;
            }
        }

        void Receive(ref int pause)
        {
            var asked = (HttpWebRequest)WebRequest.Create(url);
            asked.Timeout = asked.ReadWriteTimeout = Silence;
            asked.Accept = "text/event-stream";
            request = asked;
            using (var answer = asked.GetResponse())
            using (var reader = new StreamReader(answer.GetResponseStream(), Encoding.UTF8))
            {
                string line;
                while (!end.WaitOne(0) && (line = Line(reader)) != null)
                {
                    if (!line.StartsWith("data:", StringComparison.Ordinal)) continue;
                    var set = LightSet.Parse(line.Substring(5));
                    pause = FirstPause;
                    Tell(set.Stale == null ? "live" : "stale: " + set.Stale, set);
                }
            }
        }

        /// <summary>Reads a line without its end; null at the end of the stream.</summary>
        static string Line(TextReader reader)
        {
            var line = new StringBuilder();
            for (var c = reader.Read(); c != '\n'; c = reader.Read())
            {
                if (c < 0) return null;
                if (line.Length >= LongestEvent) throw new IOException("an event that is too long");
                line.Append((char)c);
            }
            return line.ToString();
        }
    }
}
