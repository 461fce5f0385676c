"""Light sets of a hemilux light probe.

    import hemilux
    for lights in hemilux.sets("http://127.0.0.1:8080", lights=8):     # blocking
        print(lights.frame, lights.lights[0].direction)
    async for lights in hemilux.stream("http://127.0.0.1:8080"):       # asyncio
        print(lights.frame, lights.stale)
    hemilux.change("http://127.0.0.1:8080", lights=32)                  # a setting of the probe

Sets are absolute: each replaces the one before. A reader that is slower than the probe skips sets. The exception `Refused` has one line
with the value that the probe refuses. If a probe does not answer, the functions wait, or raise `Unreachable` after `timeout` seconds.
"""

import asyncio
import json
import time
from dataclasses import dataclass, field
from typing import Any, AsyncIterator, Iterator, Optional

from .feed import Feed, Refused, ask, base_of, checked, map_bytes, path_of

__all__ = ["Light", "LightSet", "Refused", "Unreachable", "change", "get", "map_bytes", "sets", "stream"]
__version__ = "0.1.0"


class Unreachable(OSError):
    """No set arrived in time. The text is one line with the reason."""


@dataclass(frozen=True)
class Light:
    """A directional light."""

    id: int
    """Number of the light, kept from set to set for as long as the light exists."""
    direction: tuple[float, float, float]
    """Unit vector from the probe towards the light."""
    irradiance: tuple[float, float, float]
    """Perpendicular irradiance, linear red, green and blue."""
    radius_deg: float
    """Angular radius of the light as a disc, degrees."""
    age: int = 0
    """Number of frames since the light appeared."""
    parent: Optional[int] = None
    """Id of the light from which the light was split."""


@dataclass(frozen=True)
class LightSet:
    """The lights of one frame."""

    run: str
    """Name of the run, which changes at every start of the probe; ids of different runs are unrelated."""
    frame: int
    time_ns: int
    """CLOCK_MONOTONIC of the probe at the end of the burst, nanoseconds."""
    stale: Optional[str]
    """Reason why there is no newer set; None for a new one."""
    lights: tuple[Light, ...]
    ambient: Optional[tuple[tuple[float, float, float], ...]]
    """Ambient light as nine rows of spherical harmonics, where it was requested."""
    raw: dict[str, Any] = field(repr=False)
    """All members of the probe's answer."""

    @classmethod
    def of(cls, found: dict[str, Any]) -> "LightSet":
        lights = (Light(**{**light, "direction": tuple(light["direction"]), "irradiance": tuple(light["irradiance"])}) for light in found["lights"])
        ambient = found["ambient"] and tuple(map(tuple, found["ambient"]))
        return cls(**{**found, "lights": tuple(lights), "ambient": ambient})


def get(address: str, *, lights: Optional[int] = None, ambient: bool = False, soft: Optional[bool] = None, coordinates: str = "probe", timeout: float = 5.0) -> LightSet:
    """Returns the next light set of the probe."""
    path = path_of(lights, ambient, coordinates, soft).replace("/v1/events", "/v1/lights")
    try:
        with ask(base_of(address), path, timeout=timeout) as answer:
            return LightSet.of(checked(json.load(answer)))
    except (OSError, ValueError) as error:
        raise Unreachable(str(error)) from None


def sets(
    address: str, *, lights: Optional[int] = None, ambient: bool = False, soft: Optional[bool] = None, coordinates: str = "probe", timeout: Optional[float] = None
) -> Iterator[LightSet]:
    """Yields each new light set. Without `timeout`, waits for a probe that does not answer."""
    feed = Feed(address, path_of(lights, ambient, coordinates, soft))
    try:
        end = None if timeout is None else time.monotonic() + timeout
        while True:
            found = feed.wait(0.5 if end is None else max(0.0, min(0.5, end - time.monotonic())))
            if found:
                end = None if timeout is None else time.monotonic() + timeout
                yield LightSet.of(found)
            elif feed.is_refused():
                raise Refused(feed.state)
            elif end is not None and time.monotonic() >= end:
                raise Unreachable(feed.state)
    finally:
        feed.close()


async def stream(
    address: str, *, lights: Optional[int] = None, ambient: bool = False, soft: Optional[bool] = None, coordinates: str = "probe", timeout: Optional[float] = None
) -> AsyncIterator[LightSet]:
    """Yields each new light set without blocking the event loop. Without `timeout`, waits for a probe that does not answer."""
    loop, news = asyncio.get_running_loop(), asyncio.Event()

    def wake() -> None:
        try:
            loop.call_soon_threadsafe(news.set)
        except RuntimeError:
            # The loop is closed: there is no reader.
            pass

    feed = Feed(address, path_of(lights, ambient, coordinates, soft), on_change=wake)
    try:
        while True:
            found = await _next(feed, news, timeout)
            yield LightSet.of(found)
    finally:
        feed.close()


async def _next(feed: Feed, news: asyncio.Event, timeout: Optional[float]) -> dict[str, Any]:
    try:
        async with _limit(timeout):
            while True:
                news.clear()
                found = feed.take()
                if found:
                    return found
                if feed.is_refused():
                    raise Refused(feed.state)
                await news.wait()
    except (TimeoutError, asyncio.TimeoutError):
        raise Unreachable(feed.state) from None


class _limit:
    """asyncio.timeout, which Python 3.10 does not have."""

    def __init__(self, seconds: Optional[float]):
        self._seconds, self._is_late = seconds, False
        self._timer: Optional[asyncio.TimerHandle] = None

    async def __aenter__(self) -> None:
        task = asyncio.current_task()

        def end() -> None:
            self._is_late = True
            if task:
                task.cancel()

        if self._seconds is not None:
            self._timer = asyncio.get_running_loop().call_later(self._seconds, end)

    async def __aexit__(self, kind: Any, *_: Any) -> None:
        if self._timer:
            self._timer.cancel()
        if self._is_late and kind is asyncio.CancelledError:
            task = asyncio.current_task()
            if task and hasattr(task, "uncancel"):
                task.uncancel()
            raise TimeoutError


def change(address: str, token: str = "", *, timeout: float = 5.0, **settings: Any) -> dict[str, Any]:
    """Changes settings of the probe, as `lights=32`, and returns the probe's answer. A probe on the network needs its token."""
    body = json.dumps(settings).encode()
    try:
        with ask(base_of(address), "/v1/config", token, timeout, "PATCH", body) as answer:
            settings_in_effect: dict[str, Any] = json.load(answer)
            return settings_in_effect
    except (OSError, ValueError) as error:
        raise Unreachable(str(error)) from None
