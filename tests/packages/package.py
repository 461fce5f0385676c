"""Follows a probe with the installed package and checks the sets: package.py ADDRESS."""

import asyncio
import itertools
import math
import sys
import time

import hemilux

address = sys.argv[1]


def rising(found):
    return all(a.frame < b.frame for a, b in zip(found, found[1:]))


def blocking():
    found = list(itertools.islice(hemilux.sets(address, lights=4, ambient=True), 5))
    assert rising(found), [s.frame for s in found]
    assert all(len(s.lights) <= 4 and len(s.ambient) == 9 for s in found), found[0]
    light = found[0].lights[0]
    assert abs(math.hypot(*light.direction) - 1) < 1e-3 and light.id > 0, light
    one = hemilux.get(address, coordinates="unity")
    assert one.raw["coordinates"] == "unity" and one.run == found[0].run
    assert hemilux.map_bytes(address).startswith(b"#?")


async def streamed():
    beats = 0

    async def beat():
        nonlocal beats
        while True:
            await asyncio.sleep(0.01)
            beats += 1

    task = asyncio.create_task(beat())
    found = []
    async for light_set in hemilux.stream(address, lights=2):
        found.append(light_set)
        if len(found) == 6:
            break
    task.cancel()
    assert rising(found) and len(found) == 6
    assert beats > 20, f"the event loop ran {beats} times beside six sets"


def settings():
    before = hemilux.get(address)
    hemilux.change(address, lights=12)
    time.sleep(0.5)
    assert len(hemilux.get(address).lights) <= 12 < len(before.lights) + 1
    hemilux.change(address, lights=16)


def fails(kind, named, call):
    try:
        call()
    except kind as error:
        text = str(error)
        assert named in text and "\n" not in text, text
    else:
        raise AssertionError(f"{named}: expected {kind.__name__}")


async def first(where, **options):
    async for light_set in hemilux.stream(where, **options):
        return light_set


def faults():
    fails(hemilux.Unreachable, "127.0.0.1:9", lambda: next(hemilux.sets("http://127.0.0.1:9", timeout=0.5)))
    fails(hemilux.Unreachable, "127.0.0.1:9", lambda: asyncio.run(first("http://127.0.0.1:9", timeout=0.5)))
    fails(hemilux.Unreachable, "127.0.0.1:9", lambda: hemilux.get("http://127.0.0.1:9"))
    fails(hemilux.Refused, "expected http://HOST:PORT", lambda: hemilux.get("ftp://x"))
    fails(hemilux.Refused, "answered 400", lambda: next(hemilux.sets(address, coordinates="maya", timeout=5)))
    fails(hemilux.Refused, "lights", lambda: hemilux.change(address, lights=-1))


blocking()
asyncio.run(streamed())
settings()
faults()
