"""The command hemilux-lights: prints a probe's light sets."""

import argparse
import itertools
import json
import os
import sys

from . import LightSet, Refused, Unreachable, sets


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="hemilux-lights", description="Prints each light set of a hemilux light probe.")
    parser.add_argument("address", nargs="?", default="http://127.0.0.1:8080", help="the probe's address [default: %(default)s]")
    parser.add_argument("--lights", type=int, help="largest number of lights [default: all]")
    parser.add_argument("--coordinates", default="probe", help="axes: probe, blender, three, unity, unreal, ... [default: %(default)s]")
    parser.add_argument("--frames", type=int, help="number of sets after which to end [default: none]")
    parser.add_argument("--timeout", type=float, default=10.0, help="seconds without a set after which to end [default: %(default)s]")
    parser.add_argument("--json", action="store_true", help="print each set as one line of JSON")
    return parser.parse_args()


def text(found: LightSet) -> str:
    lines = [f"frame {found.frame}" + (f" stale: {found.stale}" if found.stale else "")]
    for light in found.lights:
        (x, y, z), (r, g, b) = light.direction, light.irradiance
        lines.append(f"  {light.id:6}  towards ({x:+.3f} {y:+.3f} {z:+.3f})  irradiance {r:.3g} {g:.3g} {b:.3g}")
    return "\n".join(lines)


def main() -> None:
    options = arguments()
    try:
        found = sets(options.address, lights=options.lights, coordinates=options.coordinates, timeout=options.timeout)
        for light_set in itertools.islice(found, options.frames):
            print(json.dumps(light_set.raw) if options.json else text(light_set), flush=True)
    except (Refused, Unreachable) as error:
        sys.exit(f"hemilux-lights: {error}")
    except BrokenPipeError:
        # The reader of stdout has ended: the rest of the buffer is discarded.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
