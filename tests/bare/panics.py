"""Lists the calls of panics in an ARM image: count, and the innermost source line outside of the standard library."""

import collections
import re
import subprocess
import sys

elf = sys.argv[1]
PANIC = re.compile(r"4core9panicking|_fail>|unwrap_failed|expect_failed|rust_begin_unwind|panic")


def tool(*arguments):
    return subprocess.run(["arm-linux-gnueabihf-" + arguments[0], *arguments[1:]], capture_output=True, text=True, check=True).stdout


calls = []
for line in tool("objdump", "-d", "--no-show-raw-insn", elf).splitlines():
    call = re.match(r"^\s*([0-9a-f]+):\s+b\S*\s+[0-9a-f]+ (<[^+]*>)$", line)
    if call and PANIC.search(call[2]):
        calls.append("0x" + call[1])
if not calls:
    sys.exit()
found = collections.Counter()
for chunk in re.split(r"^0x[0-9a-f]+$", tool("addr2line", "-Caife", elf, *calls), flags=re.M)[1:]:
    lines = chunk.strip().splitlines()
    frames = list(zip(lines[::2], lines[1::2]))
    ours = [f for f in frames if "/rustc/" not in f[1]]
    # Calls inside the library's panic functions are left out: they follow from calls outside of it.
    if ours:
        function, place = ours[0]
        found[f"{place.split('/core/src/')[-1].split(' ')[0]}  {function}"] += 1
for place, times in sorted(found.items()):
    print(f"  {times:3} {place}")
