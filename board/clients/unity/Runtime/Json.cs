using System;
using System.Collections.Generic;
using System.Globalization;
using System.Text;

namespace Hemilux
{
    /// <summary>A reader of JSON: objects become dictionaries, arrays lists, numbers double. UnityEngine.JsonUtility has no arrays of arrays.</summary>
    public sealed class Json
    {
        const int Deepest = 32;
        readonly string text;
        int at;

        Json(string text) { this.text = text; }

        /// <summary>Returns the value of <paramref name="text"/>. Throws FormatException with one line where it is not JSON.</summary>
        public static object Parse(string text)
        {
            var reader = new Json(text);
            var value = reader.Value(0);
            reader.Space();
            if (reader.at != text.Length) throw reader.Wrong("the end");
            return value;
        }

        FormatException Wrong(string expected)
        {
            return new FormatException("JSON, character " + at + ": expected " + expected);
        }

        void Space()
        {
            while (at < text.Length && " \t\r\n".IndexOf(text[at]) >= 0) at++;
        }

        char Next()
        {
            Space();
            if (at >= text.Length) throw Wrong("a value");
            return text[at];
        }

        bool Take(char c)
        {
            if (Next() != c) return false;
            at++;
            return true;
        }

        object Value(int depth)
        {
            if (depth > Deepest) throw Wrong("at most " + Deepest + " levels");
            switch (Next())
            {
                case '{': return Object(depth);
                case '[': return Array(depth);
                case '"': return Text();
                case 't': return Word("true", true);
                case 'f': return Word("false", false);
                case 'n': return Word("null", null);
                default: return Number();
            }
        }

        object Word(string word, object value)
        {
            if (string.CompareOrdinal(text, at, word, 0, word.Length) != 0) throw Wrong(word);
            at += word.Length;
            return value;
        }

        object Number()
        {
            var start = at;
            while (at < text.Length && "+-.0123456789eE".IndexOf(text[at]) >= 0) at++;
            double value;
            var digits = text.Substring(start, at - start);
            if (double.TryParse(digits, NumberStyles.Float, CultureInfo.InvariantCulture, out value)) return value;
            throw Wrong("a number");
        }

        List<object> Array(int depth)
        {
            var list = new List<object>();
            at++;
            if (Take(']')) return list;
            do list.Add(Value(depth + 1)); while (Take(','));
            if (!Take(']')) throw Wrong("]");
            return list;
        }

        Dictionary<string, object> Object(int depth)
        {
            var members = new Dictionary<string, object>();
            at++;
            if (Take('}')) return members;
            do
            {
                if (Next() != '"') throw Wrong("a name");
                var name = Text();
                if (!Take(':')) throw Wrong(":");
                members[name] = Value(depth + 1);
            }
            while (Take(','));
            if (!Take('}')) throw Wrong("}");
            return members;
        }

        string Text()
        {
            var found = new StringBuilder();
            for (at++; at < text.Length; at++)
            {
                if (text[at] == '"')
                {
                    at++;
                    return found.ToString();
                }
                found.Append(text[at] == '\\' ? Escaped() : text[at]);
            }
            throw Wrong("\"");
        }

        char Escaped()
        {
            at++;
            if (at >= text.Length) throw Wrong("an escape");
            var place = "\"\\/bfnrt".IndexOf(text[at]);
            if (place >= 0) return "\"\\/\b\f\n\r\t"[place];
            ushort code;
            if (text[at] != 'u' || at + 4 >= text.Length) throw Wrong("an escape");
            var digits = text.Substring(at + 1, 4);
            if (!ushort.TryParse(digits, NumberStyles.AllowHexSpecifier, CultureInfo.InvariantCulture, out code)) throw Wrong("four digits");
            at += 4;
            return (char)code;
        }
    }
}
