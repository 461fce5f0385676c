"""Multiplies llvm-mca's cycles of each basic block by the number of its executions. See `estimate`."""

import os
import re
import subprocess
import sys
from bisect import bisect_right
from collections import defaultdict

FRAMES = 2
# Blocks with this share of all executed instructions are modelled; the rest has the average cycles per instruction.
PART = 0.995
STAGES = [
    ("front", r"hemilux_core::(front|merge|response)"),
    ("pyramid", r"hemilux_core::(pyramid|fill|polar)"),
    ("sample", r"sampler::"),
]
MACHINES = {
    "ARM": ("qemu-arm -cpu cortex-a15", "arm-linux-gnueabihf", "armv7-linux-gnueabihf", "+neon,+vfp4", ["cortex-a9", "cortex-a15", "cortex-a72"]),
    "AArch64": ("qemu-aarch64", "aarch64-linux-gnu", "aarch64-linux-gnu", "+neon", ["cortex-a53", "cortex-a72"]),
}


CONDITIONS = "eq|ne|cs|hs|cc|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le"
BRANCH = re.compile(rf"^((?:b(?:l|lx)?(?:\.?(?:{CONDITIONS}))?|cbn?z|tbn?z)\s+(?:.*,\s*)?)[#0-9a-fx-]+$")


def run(command, **more):
    return subprocess.run(command, capture_output=True, text=True, check=True, **more).stdout


def functions(sim, prefix):
    """Returns start address, end address and name of each function, sorted by address."""
    found = []
    for line in run([prefix + "-nm", "-CS", "--defined-only", sim]).splitlines():
        m = re.match(r"([0-9a-f]+) ([0-9a-f]+) [tTwW] (.*)", line)
        if m:
            start = int(m[1], 16) & ~1
            found.append((start, start + int(m[2], 16), m[3]))
    return sorted(found)


def listing(sim, work, prefix, triple, features):
    """Returns the program's instructions by address."""
    found, small = {}, os.path.join(work, "sim")
    run([prefix + "-strip", "-g", "-o", small, sim])
    for line in run(["llvm-objdump", "-d", "--no-show-raw-insn", f"--triple={triple}", f"--mattr={features}", small]).splitlines():
        m = re.match(r"\s*([0-9a-f]+):\s+(\S.*)", line)
        if m:
            found[int(m[1], 16)] = re.sub(r"\s*<.*>|\s*(@|//|;).*", "", m[2])
    return found


def one_by_one(line):
    """Replaces loads and stores of register lists by those of single registers: the model of cortex-a9 does not have all lists."""
    m = re.match(r"^(v?)(push|pop|ldm|stm)\w*\s+(?:(\w+)!?,\s*)?\{(.*)\}$", line)
    if not m:
        return line
    names = []
    for part in m[4].split(", "):
        ends = re.match(r"^([a-z])(\d+)-\1(\d+)$", part)
        names += [f"{ends[1]}{i}" for i in range(int(ends[2]), int(ends[3]) + 1)] if ends else [part]
    kind = "str" if m[2] in ("push", "stm") else "ldr"
    return "\n".join("bx lr" if n == "pc" else f"{m[1]}{kind} {n}, [{m[3] or 'sp'}]" for n in names)


def text(listing, address, size):
    """Returns a block as assembler source; None if a part of it is not code."""
    lines = []
    for _ in range(size):
        line = listing.get(address)
        if line is None or line.startswith((".", "<")):
            return None
        # The target of a branch has no effect on the number of cycles.
        lines.append(BRANCH.sub(r"\1nowhere", one_by_one(line)))
        address += 4
    return "\n".join(lines)


def cycles(blocks, triple, features, cpu, comment):
    """Returns the cycles of each block, repeated a hundred times."""
    source = "".join(f"{comment} LLVM-MCA-BEGIN b{i}\n{b}\n{comment} LLVM-MCA-END\n" for i, b in enumerate(blocks))
    command = ["llvm-mca", f"-mtriple={triple}", f"-mattr={features}", f"-mcpu={cpu}", "-iterations=100"]
    done = subprocess.run(command + ["-instruction-info=0", "-resource-pressure=0"], input=source, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"estimate: llvm-mca for {cpu}: found {done.stderr.strip().splitlines()[:3]}, expected cycles")
    found = {}
    for region in re.split(r"^\[\d+\] Code Region - ", done.stdout, flags=re.M)[1:]:
        total = re.search(r"Total Cycles:\s+(\d+)", region)
        found[int(region.split()[0][1:])] = int(total[1]) / 100
    if len(found) != len(blocks):
        sys.exit(f"estimate: llvm-mca for {cpu}: found cycles of {len(found)} blocks, expected {len(blocks)}")
    return found


def main():
    sim, case, work, check = sys.argv[1:]
    header = run(["readelf", "-hlW", sim])
    machine = re.search(r"Machine:\s+(\S+)", header)[1]
    emulator, prefix, triple, features, cpus = MACHINES[machine]
    code = next(m[1] for m in re.finditer(r"LOAD\s+\S+ (\S+) .* R E ", header))
    names = functions(sim, prefix)
    frame = next(start for start, _, name in names if name == "hemilux_core::front::add_up")
    counts = os.path.join(work, "counts")
    command = emulator.split() + ["-L", "/usr/" + prefix, "-plugin", f"{work}/blocks.so,code={code},frame={frame:x}"]
    run(command + [os.path.abspath(sim), "bench", "--case", case, "--frames", str(FRAMES)], env={"COUNTS": counts})
    rows = [line.split() for line in open(counts)]
    if rows.pop() != ["frames", str(FRAMES)]:
        sys.exit(f"estimate: found other than {FRAMES} frames")

    starts = [f[0] for f in names]
    wanted = re.findall(r"^(hemilux_core::\S+) ", open(check).read(), re.M)
    wanted = list(dict.fromkeys(wanted))
    blocks = []
    for address, size, count in rows:
        address, size, count = int(address, 16), int(size), int(count)
        at = bisect_right(starts, address) - 1
        name = names[at][2] if at >= 0 and address < names[at][1] else ""
        stage = next((s for s, pattern in STAGES if re.search(pattern, name)), None)
        blocks.append((size * count, address, size, count, stage, name))
    blocks.sort(reverse=True)
    all_instructions = sum(b[0] for b in blocks)

    lines = listing(sim, work, prefix, triple, features)
    chosen, seen = [], 0
    for block in blocks:
        if seen >= PART * all_instructions:
            break
        code_text = text(lines, block[1], block[2])
        if code_text:
            chosen.append((block, code_text))
        seen += block[0]
    pixels = FRAMES * int(re.search(r"(\d+)x(\d+)", case)[1]) * int(re.search(r"(\d+)x(\d+)", case)[2])

    instructions, spent, covered = defaultdict(int), defaultdict(lambda: defaultdict(float)), defaultdict(int)

    def rows_of(block):
        hot = [w for w in wanted if block[5].startswith(w)]
        return ["all"] + ([block[4]] if block[4] else []) + hot

    for block in blocks:
        for row in rows_of(block):
            instructions[row] += block[0]
    for cpu in cpus:
        each = cycles([c for _, c in chosen], triple, features, cpu, "@" if machine == "ARM" else "#")
        for i, (block, _) in enumerate(chosen):
            for row in rows_of(block):
                spent[cpu][row] += each[i] * block[3]
                covered[row, cpu] += block[0]
    print(f"{machine}, {case}, per pixel of the image")
    print(f"{'':44}{'instructions':>13}" + "".join(f"{cpu:>12}" for cpu in cpus))
    for row in wanted + [s for s, _ in STAGES] + ["all"]:
        part = lambda cpu: instructions[row] / max(covered[row, cpu], 1)
        print(f"{row:44}{instructions[row] / pixels:13.2f}" + "".join(f"{spent[c][row] * part(c) / pixels:12.2f}" for c in cpus))


main()
