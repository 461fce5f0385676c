"""Tests OSC and MQTT with programs of other authors: see `check.sh`."""

import contextlib
import json
import os
import pathlib
import queue
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request

import paho.mqtt.client as mqtt
from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_bundle import OscBundle
from pythonosc.osc_server import BlockingOSCUDPServer

PROGRAM, WORK = sys.argv[1], pathlib.Path(sys.argv[2])
failures = []


def check(holds, text):
    print(f"  {'ok  ' if holds else 'FAIL'} {text}", flush=True)
    if not holds:
        failures.append(text)


@contextlib.contextmanager
def probe(*more):
    """A running probe: its address and its process. Its standard error is in the file `log`."""
    command = [PROGRAM, "--listen", "127.0.0.1:0", "--lights", "32", *more]
    with open(WORK / "log", "w") as log, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True) as process:
        try:
            yield re.search(r"http://[^/ ]+", process.stdout.readline()).group(), process
        finally:
            process.send_signal(signal.SIGTERM)


def ask(address, path):
    return json.load(urllib.request.urlopen(address + path, timeout=5))


def free_port(kind=socket.SOCK_STREAM):
    with socket.socket(socket.AF_INET, kind) as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]


def osc():
    print("python-osc:")
    messages, tags = queue.Queue(), queue.Queue()
    dispatcher = Dispatcher()
    dispatcher.set_default_handler(lambda address, *args: messages.put((address, args)))
    server = BlockingOSCUDPServer(("127.0.0.1", 0), dispatcher)
    plain = server.process_request

    def look(request, client):
        tags.put((OscBundle(request[0]).timestamp, len(request[0])))
        plain(request, client)

    server.process_request = look
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with probe("--osc", f"127.0.0.1:{server.server_address[1]},lights=40,coordinates=unity") as (address, _):
        seen = []
        end = time.monotonic() + 10
        while len({args[0] for name, args in seen if name == "/hemilux/set"}) < 12 and time.monotonic() < end:
            with contextlib.suppress(queue.Empty):
                seen.append(messages.get(timeout=1))
        reference = ask(address, "/v1/lights?coordinates=unity&ambient=1")
    server.shutdown()
    compare(seen, reference)
    stamps = [tags.get() for _ in range(tags.qsize())]
    off = max(abs(stamp - time.time()) for stamp, _ in stamps)
    check(off < 20 and len({stamp for stamp, _ in stamps}) >= 10, f"time tags of the wall clock, within {off:.1f} s")
    check(max(length for _, length in stamps) <= 1400, f"bundles of at most {max(length for _, length in stamps)} bytes")


def compare(seen, reference):
    frames = [args for name, args in seen if name == "/hemilux/set"]
    numbers = [args[0] for args in frames]
    check(len(numbers) >= 12 and numbers == sorted(set(numbers)), f"{len(numbers)} sets, frames rise")
    check(all(args[1] == reference["run"] and args[3] == "" for args in frames), "the run, and no reason of staleness")
    places = {}
    for name, (ident, *rest) in ((n, a) for n, a in seen if n.startswith("/hemilux/light/")):
        places.setdefault(name, []).append((ident, rest))
    check(len(places) == 40, f"{len(places)} places")
    moved = sum(before[ident] != name for before, after in pairs(seen) for ident, name in after.items() if ident in before)
    check(moved == 0, f"{moved} lights changed their place from one set to the next")
    last = {ident: rest for all_ in places.values() for ident, rest in all_ if ident}
    near = 0
    for light in reference["lights"]:
        found = last.get(light["id"])
        near += bool(found) and max(abs(a - b) for a, b in zip(found[:3], light["direction"])) < 0.1
    check(near >= 0.8 * len(reference["lights"]), f"{near} of {len(reference['lights'])} lights of /v1/lights have their id and direction in Unity's axes")
    flux = next(args for name, args in reversed(seen) if name == "/hemilux/flux")
    off = max(abs(a / b - 1) for a, b in zip(flux, reference["scalar_flux"]))
    check(off < 0.2, f"the flux is that of /v1/lights within {100 * off:.1f} % (the scene moves)")
    rows = next(args for name, args in seen if name == "/hemilux/ambient")
    check(len(rows) == 27, f"{len(rows)} harmonics")


def pairs(seen):
    """Returns, for each two consecutive light sets, the positions of both sets' lights by id."""
    sets = []
    for name, args in seen:
        if name == "/hemilux/set":
            sets.append({})
        elif sets and name.startswith("/hemilux/light/") and args[0]:
            sets[-1][args[0]] = name
    return zip(sets, sets[1:])


@contextlib.contextmanager
def broker(password=None):
    port, config = free_port(), WORK / "mosquitto.conf"
    lines = [f"listener {port} 127.0.0.1", "persistence false"]
    if password:
        subprocess.run(["mosquitto_passwd", "-b", "-c", WORK / "users", "lamp", password], check=True, stderr=subprocess.DEVNULL)
        os.chmod(WORK / "users", 0o644)
        os.chmod(WORK, 0o755)
        lines += ["allow_anonymous false", f"password_file {WORK / 'users'}"]
    else:
        lines.append("allow_anonymous true")
    config.write_text("\n".join(lines) + "\n")
    with subprocess.Popen(["mosquitto", "-c", config], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            wait_for(lambda: connects(port), "mosquitto")
            yield port
        finally:
            process.terminate()


def connects(port):
    with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
        return True
    return False


def wait_for(condition, what, seconds=15):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what}: nothing in {seconds} s"
        time.sleep(0.05)


def subscriber(port, password=None):
    found = {}
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    if password:
        client.username_pw_set("lamp", password)
    client.on_connect = lambda client, *_: client.subscribe("#")
    client.on_message = lambda _client, _data, message: found.setdefault(message.topic, []).append(message.payload.decode())
    client.connect("127.0.0.1", port)
    client.loop_start()
    return client, found


def mqtt_topics():
    print("mosquitto and paho-mqtt:")
    with broker("a@b c") as port:
        client, found = subscriber(port, "a@b c")
        with probe("--mqtt", f"mqtt://lamp:a%40b%20c@127.0.0.1:{port}/attic?every=0.2&lux=100") as (address, process):
            wait_for(lambda: len(found.get("hemilux/attic/state", ())) >= 6, "states")
            states = [json.loads(text) for text in found["hemilux/attic/state"]]
            reference = ask(address, "/v1/lights")
            stopped = time.monotonic()
            process.send_signal(signal.SIGTERM)
            process.wait(5)
            stopped = time.monotonic() - stopped
        wait_for(lambda: found["hemilux/attic/availability"][-1] == "offline", "offline")
        client.loop_stop()
    r, g, b = reference["horizontal_irradiance"]
    expected = 100 * (0.2126 * r + 0.7152 * g + 0.0722 * b)
    off = abs(states[-1]["illuminance"] / expected - 1)
    check(off < 0.2, f"illuminance: {states[-1]['illuminance']:.1f} lx, {expected:.1f} lx by /v1/lights (the scene moves)")
    check(all(2000 < s["colour_temperature"] < 12000 for s in states), f"colour temperature: {states[-1]['colour_temperature']:.0f} K")
    off = abs(states[-1]["unseen"] / 100 - reference["unseen"])
    check(off < 0.001 and states[-1]["problem"] == "OFF", f"unseen {states[-1]['unseen']} %, no problem")
    check(found["hemilux/attic/availability"] == ["online", "offline"] and stopped < 1.2, f"online, then offline when it stops, within {stopped:.2f} s")
    discovery(found)


def discovery(found):
    """Checks the requirements of Home Assistant on a discovery message: unique ids, a published topic, a template with a member of its JSON."""
    configs = {topic: json.loads(texts[-1]) for topic, texts in found.items() if topic.startswith("homeassistant/")}
    state = json.loads(found["hemilux/attic/state"][-1])
    names = [re.fullmatch(r"\{\{ value_json\.(\w+) \}\}", c["value_template"]).group(1) for c in configs.values()]
    sound = all(name in state for name in names) and all(c["state_topic"] == "hemilux/attic/state" for c in configs.values())
    check(len(configs) == 7 and sound and len({c["unique_id"] for c in configs.values()}) == 7, f"discovery of {sorted(names)}")
    lux = configs["homeassistant/sensor/hemilux_attic/illuminance/config"]
    check((lux["device_class"], lux["unit_of_measurement"]) == ("illuminance", "lx"), "an illuminance in lx")


def faults():
    """Tests an absent camera, a broker that starts late, and peers that do not answer."""
    print("faults:")
    with broker() as port:
        client, found = subscriber(port)
        with probe("--mqtt", f"mqtt://127.0.0.1:{port}/attic", "--source", f"pipe:{WORK / 'none'}"):
            wait_for(lambda: "hemilux/attic/state" in found, "a state")
        client.loop_stop()
    state = json.loads(found["hemilux/attic/state"][-1])
    check(state["problem"] == "ON" and state["illuminance"] is None and state["reason"], f"no camera: problem ON, {state['reason'][:60]}")
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen(1)
        port = silent.getsockname()[1]
        with probe("--mqtt", f"mqtt://127.0.0.1:{port}", "--osc", f"127.0.0.1:{free_port(socket.SOCK_DGRAM)}", "--osc", "none.invalid:9") as (address, process):
            first, began = ask(address, "/v1/lights")["frame"], time.monotonic()
            time.sleep(5)
            rate = (ask(address, "/v1/lights")["frame"] - first) / (time.monotonic() - began)
            stopped = time.monotonic()
            process.send_signal(signal.SIGTERM)
            process.wait(5)
            stopped = time.monotonic() - stopped
    lines = (WORK / "log").read_text().splitlines()
    named = [sum(name in line for line in lines) for name in ("none.invalid:9", "--osc 127.0.0.1")]
    check(rate > 8.5, f"three dead peers: {rate:.1f} sets a second of the scene's 10")
    check(all(1 <= n <= 3 for n in named), f"each dead peer is named in few lines: {named}")
    check(stopped < 1.2, f"the probe stops within {stopped:.2f} s")


osc()
if shutil.which("mosquitto"):
    mqtt_topics()
    faults()
else:
    print("  skipped: mosquitto is not installed")
    failures.extend(["mosquitto"] if os.environ.get("HEMILUX_RIG") else [])
print(f"peers: {'failed' if failures else 'passed'}")
sys.stdout.flush()
os._exit(1 if failures else 0)
