using System;
using NUnit.Framework;

namespace Hemilux.Tests
{
    public sealed class LightSetTests
    {
        const string Set = "{\"run\":\"k3v9x\",\"frame\":7,\"stale\":null,\"coordinates\":\"unity\",\"lights\":[{\"id\":17,\"direction\":[0.6,0.8,0],"
            + "\"irradiance\":[12,11,9],\"radius_deg\":2.1,\"age\":1,\"parent\":null}]}";

        [Test]
        public void A_set_is_read()
        {
            var set = LightSet.Parse(Set);
            Assert.AreEqual(7, set.Frame);
            Assert.AreEqual(17, set.Lights[0].Id);
            Assert.AreEqual(0.8f, set.Lights[0].Direction[1]);
            Assert.IsNull(set.AmbientSh);
        }

        [Test]
        public void What_is_no_set_is_refused()
        {
            foreach (var text in new[] { "", "[]", "{}", Set.Replace("0.6,", ""), Set.Substring(1) })
                Assert.Throws<FormatException>(() => LightSet.Parse(text), text);
        }
    }
}
