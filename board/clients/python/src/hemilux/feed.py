"""Light sets of a probe, received by a thread. Needs the standard library alone; the Blender extension has a copy of this module."""

import http.client
import json
import math
import threading
import urllib.error
import urllib.parse
import urllib.request
from typing import Any, Callable, Iterator, Optional

# Seconds without a byte after which a connection counts as dead; the probe repeats its last set every 1.5 s.
SILENCE = 4.0
FIRST_PAUSE, LONGEST_PAUSE = 0.25, 8.0
# Largest event and largest map that are read, bytes.
LARGEST_EVENT, LARGEST_MAP = 16 << 20, 256 << 20


class Refused(Exception):
    """The probe refused a request, and would refuse it again. The text is one line."""


def base_of(address: str) -> str:
    """Returns the address without a path, with `http://` where it has no scheme."""
    text = address.strip() if "://" in address else "http://" + address.strip()
    try:
        parts = urllib.parse.urlsplit(text)
        is_usable = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:
        is_usable = False
    if not is_usable:
        raise Refused(f"address '{address}': expected http://HOST:PORT")
    return f"{parts.scheme}://{parts.netloc}"


def is_loopback(address: str) -> bool:
    host = urllib.parse.urlsplit(base_of(address)).hostname or ""
    return host in ("localhost", "::1") or host.startswith("127.")


def ask(base: str, path: str, token: str = "", timeout: float = SILENCE, method: str = "GET", body: Optional[bytes] = None) -> Any:
    """Opens `path` of the probe. Raises Refused or OSError with one line where there is no answer."""
    request = urllib.request.Request(base + path, data=body, method=method)
    if token:
        request.add_header("Authorization", "Bearer " + token)
    if body is not None:
        request.add_header("Content-Type", "application/json")
    try:
        return urllib.request.urlopen(request, timeout=timeout)
    except urllib.error.HTTPError as error:
        text = " ".join(error.read(300).decode("utf-8", "replace").split())
        is_final = 400 <= error.code < 500 and error.code != 429
        raise (Refused if is_final else OSError)(f"{base}: answered {error.code}: {text}") from None
    except (OSError, http.client.HTTPException, ValueError) as error:
        raise OSError(f"{base}: no answer: {getattr(error, 'reason', error)}") from None


def map_bytes(address: str, token: str = "") -> bytes:
    """Returns the probe's newest map as Radiance HDR, +Z up."""
    with ask(base_of(address), "/v1/map.hdr", token, timeout=10) as answer:
        data: bytes = answer.read(LARGEST_MAP + 1)
    if len(data) > LARGEST_MAP or not data.startswith(b"#?"):
        raise Refused(f"{address}: found no Radiance HDR map below {LARGEST_MAP >> 20} MB")
    return data


def numbers(values: Any, count: int) -> list[float]:
    found = [float(v) for v in values]
    if len(found) != count or not all(map(math.isfinite, found)):
        raise ValueError(f"found {str(found)[:80]}, expected {count} finite numbers")
    return found


def checked_light(light: Any) -> dict[str, Any]:
    return {
        "id": int(light["id"]),
        "direction": numbers(light["direction"], 3),
        "irradiance": [max(0.0, v) for v in numbers(light["irradiance"], 3)],
        "radius_deg": min(90.0, max(0.0, numbers([light["radius_deg"]], 1)[0])),
        "age": int(light.get("age", 0)),
        "parent": light.get("parent"),
    }


def checked(found: Any) -> dict[str, Any]:
    """Returns `found` with lights and harmonics of finite numbers; raises ValueError where it is not a light set."""
    try:
        rows = found.get("ambient_sh")
        ambient = [numbers(row, 3) for row in rows] if rows is not None else None
        if ambient is not None and len(ambient) != 9:
            raise ValueError(f"found {len(ambient)} harmonics, expected 9")
        lights = [checked_light(light) for light in found["lights"]]
        run, frame, time = str(found["run"]), int(found["frame"]), int(found["timestamp_ns"])
        stale = found["stale"] and str(found["stale"]["reason"])
    except (AttributeError, KeyError, OverflowError, TypeError) as error:
        raise ValueError(f"found no light set: {error!r}") from None
    checked_set = {"run": run, "frame": frame, "time_ns": time, "stale": stale, "lights": lights, "ambient": ambient}
    return {**checked_set, "raw": found}


def path_of(lights: Optional[int] = None, ambient: bool = False, coordinates: str = "probe", soft: Optional[bool] = None) -> str:
    query: dict[str, Any] = {"coordinates": coordinates, "ambient": int(ambient)}
    if lights is not None:
        query["lights"] = lights
    if soft is not None:
        query["soft"] = int(soft)
    return "/v1/events?" + urllib.parse.urlencode(query)


class Feed:
    """Receives sets until `close`. `take` returns the newest set once, `wait` waits for it. Sets that are not taken in time are replaced."""

    def __init__(self, address: str, path: str, token: str = "", on_change: Optional[Callable[[], None]] = None):
        self.state = "connecting"
        self._base, self._path, self._token = base_of(address), path, token
        self._news, self._end = threading.Condition(), threading.Event()
        self._newest: Optional[dict[str, Any]] = None
        self._on_change = on_change or (lambda: None)
        self._thread = threading.Thread(target=self._run, name="hemilux", daemon=True)
        self._thread.start()

    def take(self) -> Optional[dict[str, Any]]:
        with self._news:
            newest, self._newest = self._newest, None
        return newest

    def wait(self, timeout: float) -> Optional[dict[str, Any]]:
        """Returns the newest set; None after `timeout` seconds, and at once when the state is `refused`."""
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._end.is_set() or self.is_refused(), timeout)
        return self.take()

    def is_refused(self) -> bool:
        return self.state.startswith("refused")

    def close(self) -> None:
        self._end.set()
        with self._news:
            self._news.notify_all()

    def _tell(self, state: str, newest: Optional[dict[str, Any]] = None) -> None:
        with self._news:
            self.state, self._newest = state, newest or self._newest
            self._news.notify_all()
        self._on_change()

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._end.is_set():
            try:
                for found in self._sets():
                    pause = FIRST_PAUSE
                    self._tell(f"stale: {found['stale']}" if found["stale"] else "live", found)
                self._tell(f"lost: {self._base}: the stream ended")
            except Refused as error:
                self._tell(f"refused: {error}")
            except (OSError, ValueError, http.client.HTTPException) as error:
                self._tell(f"lost: {error}")
            self._end.wait(pause)
            pause = min(LONGEST_PAUSE, 2 * pause)

    def _sets(self) -> Iterator[dict[str, Any]]:
        with ask(self._base, self._path, self._token) as answer:
            while not self._end.is_set():
                line = answer.readline(LARGEST_EVENT)
                if not line:
                    return
                if line.startswith(b"data:"):
                    yield checked(json.loads(line[5:]))
