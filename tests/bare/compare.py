"""Compares two light sets: the set of a board with the set of this machine."""

import json
import math
import sys

# Tolerances for float sums in another order. The sets are identical if the board adds in the order of the host.
DEGREES, RATIO = 0.01, 1e-4

host, board = (json.load(open(path)) for path in sys.argv[1:3])
if host == board:
    print(f"  {len(host['lights'])} lights, identical with this machine's")
    sys.exit()
pairs = list(zip(host["lights"], board["lights"]))
if [a["id"] for a, _ in pairs] != [b["id"] for _, b in pairs] or len(host["lights"]) != len(board["lights"]):
    sys.exit("compare.py: found other lights than this machine's, expected the same quads")


def apart(a, b):
    return 2 * math.degrees(math.asin(min(1, math.dist(a["direction"], b["direction"]) / 2)))


degrees = max(apart(a, b) for a, b in pairs)
ratio = max(abs(y / x - 1) if x else abs(y) for a, b in pairs for x, y in zip(a["irradiance"], b["irradiance"]))
print(f"  {len(pairs)} lights, at most {degrees:.2g} degrees and {ratio:.2g} of irradiance off this machine's")
if not (degrees <= DEGREES and ratio <= RATIO):
    sys.exit(f"compare.py: found that, expected at most {DEGREES} degrees and {RATIO}")
