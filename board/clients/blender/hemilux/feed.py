"""Light sets of a probe, received by a thread. No part of Blender is used here."""

import http.client
import json
import math
import threading
import urllib.error
import urllib.parse
import urllib.request

# Seconds without a byte after which a connection counts as dead; the probe repeats its last set every 1.5 s.
SILENCE = 4.0
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 8.0
# Largest event and largest map that are read, bytes.
LARGEST_EVENT, LARGEST_MAP = 16 << 20, 256 << 20


class Refused(Exception):
    """An answer that the probe does not mend by being asked again."""


def base_of(address):
    """The address without a path; `http://` where no scheme is given."""
    text = address.strip() if "://" in address else "http://" + address.strip()
    parts = urllib.parse.urlsplit(text)
    try:
        is_usable = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:
        is_usable = False
    if not is_usable:
        raise Refused(f"address '{address}': expected http://HOST:PORT")
    return f"{parts.scheme}://{parts.netloc}"


def is_loopback(address):
    host = urllib.parse.urlsplit(base_of(address)).hostname
    return host in ("localhost", "::1") or host.startswith("127.")


def ask(base, path, token="", timeout=SILENCE):
    """Opens `path` of the probe; one-line reasons where there is no answer."""
    request = urllib.request.Request(base + path)
    if token:
        request.add_header("Authorization", "Bearer " + token)
    try:
        return urllib.request.urlopen(request, timeout=timeout)
    except urllib.error.HTTPError as error:
        text = " ".join(error.read(300).decode("utf-8", "replace").split())
        refused = error.code in (400, 401, 403, 404)
        raise (Refused if refused else OSError)(f"{base}: answered {error.code}: {text}") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise OSError(f"{base}: no answer: {getattr(error, 'reason', error)}") from None


def map_bytes(address, token=""):
    """The newest map as Radiance HDR, +Z up."""
    with ask(base_of(address), "/v1/map.hdr", token, timeout=10) as answer:
        data = answer.read(LARGEST_MAP + 1)
    if len(data) > LARGEST_MAP or not data.startswith(b"#?"):
        raise Refused(f"{address}: found no Radiance HDR map below {LARGEST_MAP >> 20} MB")
    return data


def checked(found):
    """`found` as a light set whose numbers are finite; ValueError where it is none."""
    def numbers(values, count):
        values = [float(v) for v in values]
        if len(values) != count or not all(map(math.isfinite, values)):
            raise ValueError(f"found {str(values)[:80]}, expected {count} finite numbers")
        return values

    try:
        lights = [
            {
                "id": int(light["id"]),
                "direction": numbers(light["direction"], 3),
                "irradiance": [max(0.0, v) for v in numbers(light["irradiance"], 3)],
                "radius_deg": min(90.0, max(0.0, numbers([light["radius_deg"]], 1)[0])),
            }
            for light in found["lights"]
        ]
        rows = found.get("ambient_sh")
        ambient = [numbers(row, 3) for row in rows] if rows is not None else None
        if ambient is not None and len(ambient) != 9:
            raise ValueError(f"found {len(ambient)} harmonics, expected 9")
        run, frame, time = str(found["run"]), int(found["frame"]), int(found["timestamp_ns"])
        stale = found["stale"] and str(found["stale"]["reason"])
    except (AttributeError, KeyError, OverflowError, TypeError) as error:
        raise ValueError(f"found no light set: {error!r}") from None
    return {"run": run, "frame": frame, "time_ns": time, "stale": stale, "lights": lights, "ambient": ambient}


class Feed:
    """Receives sets until `close`; `take` returns the newest one once."""

    def __init__(self, address, lights, ambient, token=""):
        self.address, self.state = address, "connecting"
        self._base, self._token = base_of(address), token
        self._path = f"/v1/events?coordinates=blender&lights={lights}&ambient={int(ambient)}"
        self._lock, self._newest, self._end = threading.Lock(), None, threading.Event()
        self._thread = threading.Thread(target=self._run, name="hemilux", daemon=True)
        self._thread.start()

    def take(self):
        with self._lock:
            newest, self._newest = self._newest, None
        return newest

    def close(self):
        self._end.set()

    def _run(self):
        pause = FIRST_PAUSE
        while not self._end.is_set():
            try:
                for found in self._sets():
                    pause = FIRST_PAUSE
                    with self._lock:
                        self._newest = found
                    self.state = f"stale: {found['stale']}" if found["stale"] else "live"
                self.state = f"lost: {self._base}: the stream ended"
            except Refused as error:
                self.state = f"refused: {error}"
            except (OSError, ValueError, http.client.HTTPException) as error:
                self.state = f"lost: {error}"
            self._end.wait(pause)
            pause = min(LONGEST_PAUSE, 2 * pause)

    def _sets(self):
        with ask(self._base, self._path, self._token) as answer:
            while not self._end.is_set():
                line = answer.readline(LARGEST_EVENT)
                if not line:
                    return
                if line.startswith(b"data:"):
                    yield checked(json.loads(line[5:]))
