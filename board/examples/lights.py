#!/usr/bin/env python3
"""Prints each light set of a probe: python3 lights.py [http://127.0.0.1:8080] [frames]. Standard library alone."""
import json
import sys
import time
import urllib.request

probe = sys.argv[1] if len(sys.argv) > 1 else "http://127.0.0.1:8080"
left = int(sys.argv[2]) if len(sys.argv) > 2 else -1
url = probe + "/v1/lights?lights=4"
pause = 0.25
while left:
    try:
        # The probe answers within 1.5 s; after two seconds without an answer the request is repeated.
        with urllib.request.urlopen(url, timeout=2) as answer:
            found = json.load(answer)
    except OSError as error:
        print(f"no light set: {error}", file=sys.stderr)
        time.sleep(pause)
        pause = min(2 * pause, 8)
        continue
    pause = 0.25
    left -= 1
    url = f"{probe}/v1/lights?lights=4&after={found['frame']}"
    print(f"frame {found['frame']}" + (" stale: " + found["stale"]["reason"] if found["stale"] else ""), flush=True)
    for light in found["lights"]:
        x, y, z = light["direction"]
        r, g, b = light["irradiance"]
        print(f"  {light['id']:6}  towards ({x:+.3f} {y:+.3f} {z:+.3f})  irradiance {r:.3g} {g:.3g} {b:.3g}")
