#!/usr/bin/env python3
"""Attacks the probe's server by clients without a token, each beside a well-behaved client that must miss no frame.

usage: run.py PROGRAM [--seconds N] [--cgroup NAME] [ATTACK...]

Needs Python 3.10 and no packages; --cgroup needs root and cgroups of version 1, and gives the program the limits of the service (128 MB,
64 tasks). For each attack, starts PROGRAM on a free port of the loopback interface with the number of lights and the options of the attack,
and prints a line: numbers of frames that the well-behaved client received and missed, its longest gap between two sets, the program's
largest resident memory and number of threads, and the kernel's memory for its sockets. The exit status is 1 if a frame was missed, a gap
was over 150 ms, a set of the slow reader was older than a second, memory exceeded 64 MB, more than 8 threads ran, or a request of a
well-behaved client was lost. The gap is meaningful on an idle machine only.
"""
import argparse
import multiprocessing
import os
import re
import socket
import subprocess
import sys
import threading
import time

MEMORY_MB = 64
GAP_S = 0.150
THREADS = 8
CGROUP = {"memory/{}/memory.limit_in_bytes": 128 << 20, "pids/{}/pids.max": 64}
FAILED = []


class Program:
    """A running probe."""
    cgroup = None

    def __init__(self, path, lights, options=()):
        command = [path, "--listen", "127.0.0.1:0", "--lights", str(lights), "--open", *options]
        if Program.cgroup:
            files = " && ".join(f"echo $$ > /sys/fs/cgroup/{kind}/{Program.cgroup}/cgroup.procs" for kind in ("memory", "pids"))
            command = ["sh", "-c", f'{files} && exec "$0" "$@"', *command]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.port = int(re.search(r":(\d+)/", self.process.stdout.readline()).group(1))
        self.threads = 0
        self.kernel = 0
        self.over = False
        self.watcher = threading.Thread(target=self.watch, daemon=True)
        self.watcher.start()

    def status(self, field):
        with open(f"/proc/{self.process.pid}/status") as file:
            return int(re.search(rf"^{field}:\s+(\d+)", file.read(), re.M).group(1))

    def watch(self):
        while not self.over:
            try:
                self.threads = max(self.threads, self.status("Threads"))
            except (OSError, AttributeError):
                return
            self.kernel = max(self.kernel, self.sockets())
            time.sleep(0.5)

    def sockets(self):
        """Returns the bytes that the kernel holds for the server's side of the connections."""
        text = subprocess.run(["ss", "-Htanm", f"sport = :{self.port}"], capture_output=True, text=True).stdout
        held = re.findall(r"skmem:\(r(\d+),rb\d+,t(\d+),tb\d+,f(\d+),w(\d+)", text)
        return sum(int(r) + int(w) for r, _, _, w in held)

    def stop(self):
        self.over = True
        memory = self.status("VmHWM") / 1024
        self.process.terminate()
        began = time.monotonic()
        self.process.wait(10)
        return memory, time.monotonic() - began, self.sockets()


def connect(port, address=None, receive=None):
    sock = socket.socket()
    if receive:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive)
    if address:
        sock.bind((address, 0))
    sock.settimeout(20)
    sock.connect(("127.0.0.1", port))
    return sock


def request(path, extra=""):
    return f"GET {path} HTTP/1.1\r\nHost: localhost\r\n{extra}\r\n".encode()


def answer(sock, rest=b""):
    """Reads one answer; returns its status, its body, and the bytes after it."""
    data = bytearray(rest)
    while (end := data.find(b"\r\n\r\n")) < 0:
        receive(sock, data)
    head, start = bytes(data[:end]), end + 4
    length = int(re.search(rb"content-length: (\d+)", head.lower()).group(1))
    while len(data) < start + length:
        receive(sock, data)
    return int(head.split(b" ")[1]), bytes(data[start:start + length]), bytes(data[start + length:])


def receive(sock, data):
    more = sock.recv(1 << 20)
    if not more:
        raise ConnectionError("closed")
    data += more


def good(port, path, seconds, address, result):
    """Requests sets as the README describes; puts number of frames, number of missed frames and longest gap in seconds into `result`."""
    sock, rest = connect(port, address), b""
    got, missed, longest, last, before = 0, 0, 0.0, None, None
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        sock.sendall(request(path))
        status, body, rest = answer(sock, rest)
        now = time.monotonic()
        if status != 200:
            raise ConnectionError(f"{status}: {body[:99]}")
        match = re.search(rb'"frame":(\d+)', body[:400])
        frame = int(match.group(1)) if match else int.from_bytes(body[8:16], "little")
        if last is not None:
            missed += max(0, frame - last - 1)
            longest = max(longest, now - before)
        got, last, before = got + 1, frame, now
    result.put((got, missed, longest))


def beside(program, seconds, path="/lights.json", address="127.0.9.9"):
    result = multiprocessing.Queue()
    process = multiprocessing.Process(target=good, args=(program.port, path, seconds, address, result))
    process.start()
    return process, result


def report(name, program, found, note=""):
    got, missed, longest = found
    memory, ended, left = program.stop()
    print(f"{name:22} frames {got:4} missed {missed:3} gap {1000 * longest:4.0f} ms  memory {memory:5.1f} MB  "
          f"threads {program.threads:2}  sockets {program.kernel / 1e6:5.1f} MB, {left / 1e6:.1f} after the end ({ended:.2f} s)  {note}", flush=True)
    if missed or longest > GAP_S or program.threads > THREADS or memory + program.kernel / 1e6 > MEMORY_MB or ended > 1.2 or left > 1e6:
        FAILED.append(name)


def flood(port, paths, seconds, each, keep=None):
    """Runs `each` clients of one address in a separate process; each requests its own path repeatedly and discards the answers."""
    def client(index):
        address, path = f"127.0.{1 + index // 30}.{1 + index % 200 if keep is None else 1}", paths[index % len(paths)]
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            try:
                sock, rest = connect(port, address), b""
                while time.monotonic() < end:
                    sock.sendall(request(path))
                    _, _, rest = answer(sock, rest)
            except (OSError, ConnectionError):
                time.sleep(0.02)
    threads = [threading.Thread(target=client, args=(i,), daemon=True) for i in range(each)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(seconds + 5)


def flooded(args, name, lights, paths, clients, path="/lights.json"):
    program = Program(args.program, lights)
    process = multiprocessing.Process(target=flood, args=(program.port, paths, args.seconds + 2, clients, 1))
    process.start()
    time.sleep(1.5)
    watched, result = beside(program, args.seconds, path)
    found = result.get(timeout=args.seconds + 30)
    watched.join()
    process.terminate()
    process.join()
    report(name, program, found)


def alone(args):
    """Runs the well-behaved client without an attack, as a baseline of the machine."""
    for lights, path in ((64, "/lights.json"), (2000, "/lights.json"), (20000, "/lights.json"), (50000, "/v1/lights?format=binary")):
        program = Program(args.program, lights)
        watched, result = beside(program, args.seconds, path)
        found = result.get(timeout=args.seconds + 30)
        watched.join()
        report(f"alone, {lights} lights", program, found)


def distinct_lights(args):
    for lights in (2000, 8000, 20000):
        paths = [f"/v1/lights?lights={lights - 1 - 7 * i}" for i in range(30)]
        flooded(args, f"30 at {lights} lights", lights, paths, 30)


def large_sets(args):
    forms = [f"/v1/lights?format={f}&coordinates={c}" for f in ("json", "xml", "text") for c in ("unity", "three", "unreal")]
    flooded(args, "8 forms at 50000", 50000, forms, 8, "/v1/lights?format=binary")


def pictures(args):
    paths = ["/capture", "/v1/map.exr", "/image", "/v1/map.hdr", "/screenshot", "/v1/map.png", "/v1/mask.png", "/image?0"]
    flooded(args, "240 pictures", 64, paths, 240)


def slow_reader(args):
    """Reads an event stream at 60 KB/s and reports the age of its sets."""
    program = Program(args.program, 64)
    sock, text, oldest, frames = connect(program.port, "127.0.8.1"), b"", 0.0, 0
    watched, result = beside(program, 3 * args.seconds)
    sock.sendall(request("/v1/events"))
    began = time.monotonic()
    while time.monotonic() - began < 3 * args.seconds:
        time.sleep(0.05)
        text += sock.recv(3000)
        *whole, text = text.split(b"\n\n")
        for event in whole:
            at = event.find(b"data: ")
            if at >= 0:
                data = event[at + 6:]
                stamp = int(re.search(rb'"timestamp_ns":(\d+)', data).group(1))
                oldest, frames = max(oldest, time.monotonic() - stamp / 1e9), frames + 1
    found = result.get(timeout=30)
    watched.join()
    if oldest > 1.0:
        FAILED.append("slow reader")
    report("slow reader", program, found, f"its sets: {frames}, the oldest {oldest:.2f} s")


def hold(held, path, *address):
    """Requests a path over a new connection and appends the connection to `held`; does nothing if the connection is refused."""
    try:
        sock = connect(*address)
        sock.sendall(request(path))
        held.append(sock)
    except OSError:
        pass


def report_held(name, program, watched, result, held):
    """Reports the results of the well-behaved client that ran while the connections of a list were open."""
    found = result.get(timeout=30)
    watched.join()
    report(name, program, found, f"{len(held)} opened")


def never_read(args):
    """Opens event streams of one address that are never read or closed, one every 20 ms."""
    program = Program(args.program, 2000)
    watched, result = beside(program, args.seconds)
    held, end = [], time.monotonic() + args.seconds
    while time.monotonic() < end:
        hold(held, "/v1/events", program.port, "127.0.8.1")
        time.sleep(0.02)
    report_held("never read", program, watched, result, held)


def slow_answers(args):
    """Runs 256 clients that each request a large set and read it at a few bytes per second."""
    program = Program(args.program, 20000)
    held, end = [], time.monotonic() + args.seconds
    watched, result = beside(program, args.seconds, "/v1/lights?format=binary")
    while time.monotonic() < end:
        for i in range(8):
            hold(held, "/lights.json", program.port, f"127.0.{1 + i}.1", 4096)
        time.sleep(0.1)
    report_held("slow large answers", program, watched, result, held)


def poll(port, count, result):
    sock, rest, lost = connect(port), b"", 0
    for _ in range(count):
        try:
            sock.sendall(request("/client.js"))
            status, _, rest = answer(sock, rest)
            lost += status != 200
        except (OSError, ConnectionError):
            lost += 1
            sock, rest = connect(port), b""
    result.put(lost)


def stalled_heads(args):
    """Sends 20,000 requests of 12 well-behaved clients beside 32 connections of the same address that never complete their head."""
    program = Program(args.program, 64)
    over = threading.Event()

    def stall():
        while not over.is_set():
            try:
                sock = connect(program.port)
                sock.sendall(b"GET / HTTP/1.1\r\nHost: loc")
                sock.settimeout(1)
                while not over.is_set():
                    try:
                        if not sock.recv(64):
                            break
                    except TimeoutError:
                        pass
            except OSError:
                time.sleep(0.05)
    for _ in range(32):
        threading.Thread(target=stall, daemon=True).start()
    time.sleep(0.5)
    result = multiprocessing.Queue()
    clients = [multiprocessing.Process(target=poll, args=(program.port, 20000 // 12 + 1, result)) for _ in range(12)]
    for client in clients:
        client.start()
    lost = sum(result.get(timeout=120) for _ in clients)
    over.set()
    if lost:
        FAILED.append("stalled heads")
    report("stalled heads", program, (0, 0, 0.0), f"{20000 // 12 * 12 + 12} requests, {lost} lost")


def guesses(args):
    """Counts guesses of the token per second over one connection."""
    token = f"/tmp/hemilux-token-{os.getpid()}"
    command = [args.program, "--listen", "127.0.0.1:0", "--token-file", token]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    port = int(re.search(r":(\d+)/", process.stdout.readline()).group(1))
    sock, rest, looked, end = connect(port), b"", 0, time.monotonic() + args.seconds
    while time.monotonic() < end:
        sock.sendall(request("/v1/map.png", "Authorization: Bearer 0123456789abcdef\r\n"))
        status, _, rest = answer(sock, rest)
        looked += status == 401
    print(f"{'guesses':22} {looked} looked at in {args.seconds} s", flush=True)
    if looked > 10 + args.seconds:
        FAILED.append("guesses")
    process.terminate()
    process.wait(10)
    os.remove(token)


ATTACKS = {f.__name__: f for f in (alone, distinct_lights, large_sets, pictures, slow_reader, never_read, slow_answers, stalled_heads, guesses)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--seconds", type=int, default=10, help="duration of each attack, seconds")
    parser.add_argument("attacks", nargs="*", metavar="ATTACK", help=", ".join(ATTACKS))
    parser.add_argument("--cgroup", help="name of a cgroup that is created for the program")
    args = parser.parse_intermixed_args()
    if args.cgroup:
        for file, limit in CGROUP.items():
            file = f"/sys/fs/cgroup/{file.format(args.cgroup)}"
            os.makedirs(os.path.dirname(file), exist_ok=True)
            with open(file, "w") as limits:
                limits.write(str(limit))
        Program.cgroup = args.cgroup
    for name in args.attacks or ATTACKS:
        ATTACKS[name](args)
    if FAILED:
        sys.exit("failed: " + ", ".join(FAILED))


if __name__ == "__main__":
    main()
