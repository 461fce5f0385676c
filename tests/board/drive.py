#!/usr/bin/env python3
"""Boots the guest, runs the steps of guest/rig.sh and checks their results. Exits with status 0 only if every check passes."""
import argparse, io, json, os, socket, subprocess, sys, tarfile, threading, time, tomllib, urllib.request

parser = argparse.ArgumentParser()
for name in ("arch", "qemu", "kernel", "initrd"):
    parser.add_argument(f"--{name}", required=True)
parser.add_argument("--frames", type=int, default=200)
parser.add_argument("--disconnects", type=int, default=3)
parser.add_argument("--deb", action="store_true", help="the guest has a package, which it installs and removes")
parser.add_argument("--console", help="file for the guest's console output")
options = parser.parse_args()

# Luma of vivid's white at brightness 128 is 234 (measured with v4l2-ctl, limited range); brightness shifts it linearly.
VALUES = [32, 80, 128]
LUMA = [234 - (128 - v) for v in VALUES]

# Timeout of every wait, seconds. A wait ends with its event, so a long timeout costs no time on a fast machine.
PATIENCE = 600

# Number of buffers that the probe lends the driver.
BUFFERS = 6


def fail(why):
    print(f"rig: {options.arch}: {why}", file=sys.stderr)
    sys.exit(1)


def check(truth, why):
    if not truth:
        fail(why)


class Guest:
    """The guest: a QEMU process and its console."""

    def __init__(self):
        ports = []
        sockets = [socket.socket() for _ in range(2)]
        for s in sockets:
            s.bind(("127.0.0.1", 0))
            ports.append(s.getsockname()[1])
        for s in sockets:
            s.close()
        self.probe, self.files = (f"http://127.0.0.1:{p}" for p in ports)
        forward = f"user,id=n,restrict=on,hostfwd=tcp:127.0.0.1:{ports[0]}-:8080,hostfwd=tcp:127.0.0.1:{ports[1]}-:8081"
        # The guest's clock advances by two nanoseconds per instruction (a processor of 500 MIPS), so the guest's time is independent of the load
        # of the host, and the camera is never late because of other processes.
        common = ["-icount", "shift=1,sleep=off", "-rtc", "clock=vm", "-m", "512", "-nographic", "-nodefaults", "-no-reboot", "-serial", "stdio", "-accel", "tcg", "-kernel", options.kernel,
                  "-initrd", options.initrd, "-netdev", forward]
        if options.arch == "arm":
            machine = ["arm", "-M", "virt", "-cpu", "cortex-a7", "-append", "console=ttyAMA0 quiet panic=-1", "-device", "virtio-net-device,netdev=n"]
        else:
            machine = ["x86_64", "-M", "q35", "-cpu", "max", "-append", "console=ttyS0 quiet panic=-1", "-device", "virtio-net-pci,netdev=n,romfile="]
        root = options.qemu
        env = dict(os.environ, LD_LIBRARY_PATH=f"{root}/usr/lib/x86_64-linux-gnu:{root}/lib/x86_64-linux-gnu")
        self.process = subprocess.Popen([f"{root}/usr/bin/qemu-system-{machine[0]}", *machine[1:], *common], env=env,
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        self.lines, self.began = [], time.time()
        threading.Thread(target=self.listen, daemon=True).start()

    def listen(self):
        for line in self.process.stdout:
            self.lines.append(line.decode(errors="replace").strip())

    def tell(self, line):
        self.process.stdin.write((line + "\n").encode())
        self.process.stdin.flush()

    def next(self, mark):
        """Returns the rest of the next line that begins with `mark`, without those that were waited for before."""
        told = self.wait(mark)
        self.lines.remove(f"RIG {mark} {told}".strip())
        return told

    def wait(self, mark):
        """Returns the rest of the guest's first line that begins with `mark`."""
        end = time.time() + PATIENCE
        while time.time() < end:
            for line in self.lines:
                if line.startswith("RIG exit") and mark != "exit":
                    self.give_up(f"the guest ended before '{mark}'")
                if line.startswith(f"RIG {mark}"):
                    print(f"  {time.time() - self.began:6.1f} s  {line[4:]}")
                    return line[4 + len(mark):].strip()
            if self.process.poll() is not None:
                self.give_up(f"QEMU ended before '{mark}'")
            time.sleep(0.05)
        self.give_up(f"no '{mark}' in {PATIENCE} s")

    def give_up(self, why):
        print("\n".join(self.lines[-40:]), file=sys.stderr)
        fail(why)

    def file(self, name):
        return urllib.request.urlopen(f"{self.files}/{name}", timeout=PATIENCE).read()

    def until(self, found, why):
        """Calls `found` until it returns a true value, which is returned; gives up with `why` after the timeout."""
        end = time.time() + PATIENCE
        while not (it := found()):
            if time.time() > end:
                self.give_up(why)
            time.sleep(0.1)
        return it

    def lights(self):
        return json.loads(urllib.request.urlopen(f"{self.probe}/lights.json", timeout=PATIENCE).read())


def judge_compliance(text):
    """Checks that all tests of v4l2-compliance pass, except one: v4l-utils is older than the kernel and has another name of a pixel format."""
    failed = [line for line in text.splitlines() if "fail:" in line or line.rstrip().endswith(": FAIL")]
    ours = [line for line in failed if "fmtdesc.description mismatch" not in line and "VIDIOC_ENUM_FMT" not in line]
    check(not ours, f"v4l2-compliance: {ours}")
    total = [line for line in text.splitlines() if line.startswith("Total for vivid")]
    check(len(total) == 1, "v4l2-compliance did not end")
    print(f"           {total[0]}")


def lost(frames):
    """Returns the numbers of missing frames: while the probe held all buffers, and while the driver had a buffer but was late."""
    ours = theirs = 0
    for k in range(1, len(frames)):
        for sequence in range(frames[k - 1]["sequence"] + 1, frames[k]["sequence"]):
            due = frames[0]["timestamp_ns"] + (sequence - frames[0]["sequence"]) * 40_000_000
            held = sum(due <= f["arrived_ns"] for f in frames[max(0, k - BUFFERS):k])
            ours, theirs = (ours + 1, theirs) if held >= BUFFERS else (ours, theirs + 1)
    return ours, theirs


def judge_schedule(report):
    """Checks that each frame has exactly the brightness that the schedule assigns to its sequence number."""
    frames = report["frames"]
    check(len(frames) == options.frames and report["delay"] is not None, f"check: {len(frames)} frames, delay {report['delay']}")
    known = [f for f in frames if f["exposure"] is not None]
    wrong = [f for f in known if abs(f["level"] * 219 + 16 - LUMA[f["exposure"]]) > 1.5]
    span = frames[-1]["sequence"] - frames[0]["sequence"] + 1
    print(f"           {len(frames)} of {span} frames, {report['rate_hz']:.2f} Hz, {len(known)} with a known exposure, {len(wrong)} wrong, "
          f"{report['late']} writes left out as late, control delay {report['delay']}")
    check(not wrong, f"check: {len(wrong)} frames of another brightness than scheduled: {wrong[:3]}")
    ours, theirs = lost(frames)
    if ours + theirs:
        print(f"           {ours} frames lost for want of a buffer, {theirs} by the driver although it had one")
    check(ours + theirs == 0, f"check: {ours} frames lost by the probe, {theirs} by the driver")
    check(abs(report["rate_hz"] - 25) < 0.3, f"check: {report['rate_hz']} Hz")
    check(report["broken"] == 0, f"check: {report['broken']} broken frames")
    check(len(known) >= 0.95 * len(frames), f"check: {len(known)} frames with a known exposure")
    for slot in range(3):
        check(sum(f["exposure"] == slot for f in known) > 0.2 * len(known), f"check: exposure {slot} hardly came")


def judge_recording(archive):
    """Checks that the raw frames have the luma of the exposures in burst.toml."""
    tar = tarfile.open(fileobj=io.BytesIO(archive))
    read = lambda name: tar.extractfile(f"rec/{name}").read()
    bursts = tomllib.loads(read("sequence.toml").decode())["burst"]
    check(len(bursts) == 4, f"record: {len(bursts)} bursts")
    for burst in bursts:
        manifest = tomllib.loads(read(f"{burst['folder']}/burst.toml").decode())
        form = manifest["format"]
        check((form["width"], form["height"], form["fourcc"], form["bytes_per_line"]) == (640, 480, "YUYV", 1280), f"record: {form}")
        for frame, expected in zip(manifest["frame"], LUMA, strict=True):
            raw = read(f"{burst['folder']}/{frame['file']}")
            luma = raw[::2]
            check(len(raw) == 614400 and abs(sum(luma) / len(luma) - expected) < 1.5, f"record: {frame}, luma {sum(luma) / len(luma)}")
            check(frame["known"] == "predicted", f"record: {frame}: the control delay was not found out")
        numbers = [f["sequence"] for f in manifest["frame"]]
        check(max(numbers) - min(numbers) < 6, f"record: frames {numbers} in one burst")


def judge_upgrade():
    """Saves a setting; checks that the probe serves with it while dpkg replaces the package by a later and by the former version, and after each
    restart."""
    body = json.dumps({"lights": 20}).encode()
    change = urllib.request.Request(f"{guest.probe}/v1/config?save=1", body, {"Content-Type": "application/json"}, method="PATCH")
    # Status 202, without saving, if no frame has applied the change in time.
    guest.until(lambda: urllib.request.urlopen(change, timeout=PATIENCE).status == 200, "the setting was not saved")
    versions = []
    for _ in range(2):
        for mark in ("replaced", "restarted"):
            guest.tell("go")
            told = guest.next(mark)
            versions += [told] if mark == "replaced" else []
            found = json.loads(urllib.request.urlopen(f"{guest.probe}/v1/config", timeout=PATIENCE).read())["values"]["lights"]
            check(found == 20, f"{mark} {told}: {found} lights, expected the saved 20")
            last = guest.lights()["frame"]
            guest.until(lambda: guest.lights()["frame"] != last, f"{mark}: no new frame")
    check(versions[0] == versions[1] + "+later", f"versions {versions}, expected a later one and the former one")


def held(line):
    words = line.split()
    value = lambda name: int(words[words.index(name) + 1])
    return {name: value(name) for name in ("fds", "maps", "threads", "VmRSS:", "VmHWM:")}


guest = Guest()
try:
    guest.wait("ready")
    time.sleep(0.3)
    guest.tell(f"{options.frames} {options.disconnects}")
    if options.deb:
        guest.wait("installed")
    guest.wait("compliance")
    judge_compliance(guest.file("compliance.txt").decode(errors="replace"))
    guest.wait("devices")
    cameras = json.loads(guest.file("devices.json"))
    sizes = [(s["width"], s["height"]) for f in cameras[0]["formats"] if f["fourcc"] == "YUYV" for s in f["sizes"]]
    check(len(cameras) == 1 and cameras[0]["driver"] == "vivid" and (640, 480) in sizes, f"devices: {cameras}")
    guest.wait("check")
    judge_schedule(json.loads(guest.file("check.json")))
    guest.wait("record")
    judge_recording(guest.file("rec.tar"))
    guest.wait("serving")
    first = guest.lights()
    newer = lambda light_set: light_set if light_set["frame"] > first["frame"] else None
    then = guest.until(lambda: newer(guest.lights()), f"no frame after {first['frame']}")
    check(first["valid"] and first["stale"] is None and first["lights"] and sum(first["scalar_flux"]) > 0, f"lights: {first}")
    print(f"           {len(first['lights'])} lights, frames {first['frame']} and {then['frame']}, latency {then['latency_us']}")
    guest.tell("go")
    for n in range(options.disconnects):
        if n == 0:
            guest.wait("pulled")
            gone = lambda stale: stale if stale and "found no camera" in stale["reason"] else None
            stale = guest.until(lambda: gone(guest.lights()["stale"]), "no light set that says that the camera is unplugged")
            print(f"           stale: {stale}")
            guest.tell("go")
        guest.wait(f"plugged {n}")
        # Two bursts may have been in progress at the disconnect; a third is of the reconnected camera.
        last = guest.lights()["frame"]
        guest.until(lambda: guest.lights()["frame"] > last + 2, f"no recovery after disconnect {n}")
        guest.tell("go")
    after = guest.wait("held-after")
    guest.wait("recovered")
    if options.disconnects > 3:
        before, after = held(guest.wait("held-before")), held(after)
        for name in ("fds", "maps", "threads"):
            check(after[name] <= before[name], f"leaked {name}: {before} then {after}")
        check(after["VmRSS:"] <= before["VmRSS:"] + 1024, f"memory grew: {before} then {after}")
    else:
        after = held(after)
    check(after["VmHWM:"] <= 40 * 1024, f"resident memory: {after['VmHWM:']} kB, at most 40 MB")
    log = guest.file("serve.log").decode(errors="replace")
    warnings = [line for line in log.splitlines() if "WARN" in line]
    check(len(warnings) == options.disconnects, f"{len(warnings)} warnings for {options.disconnects} disconnects: {warnings[:5]}")
    fresh = guest.lights()
    check(fresh["stale"] is None and fresh["run"] == first["run"], "not the same probe, or not fresh")
    if options.deb:
        judge_upgrade()
    guest.tell("go")
    check(guest.wait("stopped") == "0", "the probe did not end well")
    guest.tell("go")
    if options.deb:
        guest.wait("removed")
    check(guest.wait("exit") == "0", "the guest failed")
    guest.process.wait(PATIENCE)
finally:
    if guest.process.poll() is None:
        guest.process.kill()
    if options.console:
        with open(options.console, "w") as file:
            file.write("\n".join(guest.lines) + "\n")
print(f"rig: {options.arch} passed")
