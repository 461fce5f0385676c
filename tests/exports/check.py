"""Opens exported light sets in the programs of the formats: see `check.sh`."""

import argparse
import json
import pathlib
import subprocess
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
mi.set_log_level(mi.LogLevel.Error)
from pxr import Usd, UsdGeom, UsdLux, UsdValidation  # noqa: E402

LIGHTS = 64
# Largest errors, ratios: of an irradiance in a file, of the irradiance of a rendered plane, of a picture relative to its mean.
FILE_ERROR, PLANE_ERROR, PICTURE_ERROR = 1e-5, 0.01, 0.04
PICTURE, LARGE_PICTURE = (128, 96), (288, 216)
SAMPLES = 512
failures = []


def check(holds, text):
    print(f"  {'ok  ' if holds else 'FAIL'} {text}")
    if not holds:
        failures.append(text)


class Export:
    """The light set of one map, exported in every form."""

    def __init__(self, options, env, name):
        self.options, self.env, self.name = options, env, name
        self.set = json.loads(self.file("json", "--coordinates", "y-up").read_text())
        self.directions = np.array([light["direction"] for light in self.set["lights"]])
        self.radii = np.array([light["radius_deg"] for light in self.set["lights"]])
        self.irradiances = np.array([light["irradiance"] for light in self.set["lights"]])

    def file(self, form, *more):
        path = self.options.work / f"{self.name}.{form}"
        command = [self.options.sim, "decompose", "--env", self.env, "--lights", str(LIGHTS), "--format", form, *more]
        path.write_bytes(subprocess.run(command, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL).stdout)
        return path


def compare_lights(form, export, directions, irradiances):
    same = len(directions) == len(export.directions)
    check(same, f"{form}: {len(directions)} lights of {len(export.directions)}")
    if same:
        off = np.abs(np.array(directions) - export.directions).max()
        scale = np.maximum(export.irradiances, 1e-9)
        error = (np.abs(np.array(irradiances) - export.irradiances) / scale).max()
        check(off < 1e-5 and error < FILE_ERROR, f"{form}: directions within {off:.1e}, irradiances within {error:.1e}")


def map_direction(u, v):
    """Returns the direction in +Y-up axes of a position in a map, 0..1, as METRICS.md defines it."""
    theta, phi = np.pi * v, np.pi - 2 * np.pi * u
    x, y, z = np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
    return np.array([x, z, -y])


def texture_direction(u, v):
    """Returns the direction of a position in an OpenEXR map: longitude +180 degrees at the left edge to -180, 0 at +Z and 90 at +X; +Y at the upper edge."""
    longitude, latitude = np.pi - 2 * np.pi * u, np.pi / 2 - np.pi * v
    return np.array([np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)])


def usd(export):
    path = export.file("usda", "--map", export.options.work / f"{export.name}.exr")
    stage = Usd.Stage.Open(str(path))
    lights = [prim for prim in stage.Traverse() if prim.IsA(UsdLux.DistantLight)]
    cache, directions, irradiances, angles = UsdGeom.XformCache(), [], [], []
    for prim in lights:
        light = UsdLux.DistantLight(prim)
        # A DistantLight shines along its local -Z; Gf multiplies row vectors.
        travel = cache.GetLocalToWorldTransform(prim).TransformDir((0, 0, -1))
        directions.append([-v for v in travel])
        irradiances.append([light.GetIntensityAttr().Get() * c for c in light.GetColorAttr().Get()])
        angles.append(light.GetAngleAttr().Get())
        assert light.GetNormalizeAttr().Get()
    compare_lights("usda", export, directions, irradiances)
    off = np.abs(np.array(angles) - 2 * export.radii).max()
    check(off < 1e-4 and max(angles) > 1, f"usda: inputs:angle is twice the radius, within {off:.1e} degrees of up to {max(angles):.1f}")
    (dome,) = [prim for prim in stage.Traverse() if prim.IsA(UsdLux.DomeLight)]
    texture = UsdLux.DomeLight(dome).GetTextureFileAttr().Get()
    check(texture.resolvedPath != "", f"usda: the map {texture.path} is found beside the file")
    turn = cache.GetLocalToWorldTransform(dome)
    places = [(u, v) for u in (0.1, 0.4, 0.9) for v in (0.2, 0.7)]
    off = max(np.abs(np.array(turn.TransformDir(tuple(texture_direction(u, v)))) - map_direction(u, v)).max() for u, v in places)
    check(off < 1e-6, f"usda: the dome's texels lie where the map's do, within {off:.1e}")
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    faults = [f.GetMessage() for f in UsdValidation.ValidationContext(validators).Validate(stage)]
    check(not faults, f"usda: {len(faults)} faults by {len(validators)} validators {faults}")


def white(reflectance):
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": reflectance}}


def film(width, height):
    return {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgb", "rfilter": {"type": "box"}}


def rendered(parts, emitters, samples, seed=1):
    lights = {f"emitter{i}": emitter for i, emitter in enumerate(emitters)}
    scene = mi.load_dict({"type": "scene", **parts, **lights})
    return np.array(mi.render(scene, spp=samples, seed=seed), dtype=np.float64)


def exported(export):
    """Returns the emitters of the exported file, as Mitsuba reads them."""
    return mi.load_file(str(export.file("mitsuba"))).emitters()


def plane(export):
    """Checks that a white diffuse plane that faces +Y has the radiance E / pi."""
    transform = mi.ScalarTransform4f
    down = transform().look_at(origin=[0, 1, 0], target=[0, 0, 0], up=[0, 0, 1]) @ transform().scale(0.5)
    parts = {
        "integrator": {"type": "path", "max_depth": 2},
        "sensor": {"type": "orthographic", "to_world": down, "film": film(16, 16)},
        "plane": {"type": "rectangle", "to_world": transform().rotate([1, 0, 0], -90), "bsdf": white(1.0)},
    }
    found = np.pi * rendered(parts, exported(export), 8192).reshape(-1, 3).mean(axis=0)
    expected = (export.irradiances * np.maximum(export.directions[:, 1:2], 0)).sum(axis=0)
    error = np.abs(found / expected - 1).max()
    check(error < PLANE_ERROR, f"mitsuba: a white plane receives {found}, expected {expected}: off by {100 * error:.2f} %")


def still_life(size):
    """Returns a scene of diffuse bodies on a floor that fills the picture, with indirect light."""
    transform = mi.ScalarTransform4f
    camera = transform().look_at(origin=[0, 7, 7], target=[0, 0.3, 0], up=[0, 1, 0])
    floor = transform().rotate([1, 0, 0], -90) @ transform().scale(30)
    box = transform().translate([1.7, 0.8, -0.4]) @ transform().rotate([0, 1, 0], 30) @ transform().scale([0.5, 0.8, 0.5])
    red, blue = ({"type": "diffuse", "reflectance": {"type": "rgb", "value": rgb}} for rgb in ([0.7, 0.25, 0.2], [0.2, 0.35, 0.7]))
    return {
        "integrator": {"type": "path", "max_depth": 4},
        "sensor": {"type": "perspective", "fov": 38, "to_world": camera, "film": film(*size)},
        "floor": {"type": "rectangle", "to_world": floor, "bsdf": white(0.6)},
        "ball": {"type": "sphere", "center": [-1.2, 1.0, 0.2], "radius": 1.0, "bsdf": white(0.8)},
        "small": {"type": "sphere", "center": [0.5, 0.45, 1.6], "radius": 0.45, "bsdf": red},
        "box": {"type": "cube", "to_world": box, "bsdf": blue},
    }


def environment(export):
    """Returns the map as an emitter. Mitsuba has the left edge at -Z and the first quarter at +X of a +Y-up frame, the map its left edge at -X."""
    bitmap = mi.Bitmap(str(export.options.work / f"{export.name}.exr"))
    bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    turn = mi.ScalarTransform4f().rotate([0, 1, 0], 90)
    return mi.load_dict({"type": "envmap", "bitmap": bitmap, "to_world": turn})


def pictures(export, size, samples, seed):
    """Returns pictures of the bodies under the map and under the lights."""
    return [rendered(still_life(size), emitters, samples, seed) for emitters in ([environment(export)], exported(export))]


def compare_pictures(export):
    """Compares the pictures by the mean product of two independent differences: the mean squared error without the noise of the path tracer."""
    (reference, found), (again, found_again) = (pictures(export, PICTURE, SAMPLES, seed) for seed in (1, 2))
    mean = (reference.mean() + again.mean()) / 2
    error = np.sqrt(max(0, ((found - reference) * (found_again - again)).mean())) / mean
    noise = np.sqrt(((found - found_again) ** 2 + (reference - again) ** 2).mean() / 4) / mean
    bias = (found.mean() + found_again.mean()) / 2 / mean - 1
    text = f"RMSE {100 * error:.2f} % of the mean beside {100 * noise:.2f} % of noise; means differ by {100 * bias:+.2f} %"
    check(error < PICTURE_ERROR, f"mitsuba: a picture under the map and under {LIGHTS} lights: {text}")


def save(path, reference, found):
    from PIL import Image

    both = np.concatenate([reference, np.full((reference.shape[0], 4, 3), 1e9), found], axis=1)
    both = np.clip(both / np.quantile(reference, 0.97), 0, 1)
    encoded = np.where(both <= 0.0031308, 12.92 * both, 1.055 * both ** (1 / 2.4) - 0.055)
    Image.fromarray((255 * encoded + 0.5).astype(np.uint8)).save(path, optimize=True)


def main():
    parser = argparse.ArgumentParser()
    for name in ("sim", "validator", "work"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("--maps", type=pathlib.Path)
    parser.add_argument("--write", type=pathlib.Path)
    options = parser.parse_args()
    maps = sorted(options.maps.glob("*.exr"))[:3] if options.maps else ["scene:room", "scene:sky"]
    assert maps, f"{options.maps}: found no .exr, expected maps"
    models = []
    for index, env in enumerate(maps):
        name = pathlib.Path(str(env).replace("scene:", "")).stem
        print(f"{name}:", flush=True)
        export = Export(options, env, name)
        usd(export)
        models.append(export.file("glb"))
        plane(export)
        compare_pictures(export)
        if index == 0 and options.write:
            save(options.write, *pictures(export, LARGE_PICTURE, SAMPLES, 1))
    print("gltf-validator:", flush=True)
    check(subprocess.run(["node", options.validator, *models]).returncode == 0, "glb: neither errors nor warnings")
    print(f"exports: {'failed' if failures else 'passed'}")
    sys.exit(1 if failures else 0)


main()
