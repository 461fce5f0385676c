"""Renders one object under a map, under 16 points and under 16 discs with Mitsuba 3."""
import json, sys
import numpy as np
import mitsuba as mi
mi.set_variant("scalar_rgb")
T = mi.ScalarTransform4f
env, points, discs, out = sys.argv[1:5]

def lights(path):
    return json.load(open(path))["lights"]

def yup(d):  # probe axes (x, y, z up) to y up
    return [d[0], d[2], -d[1]]

def disc_map(set_, w=1024, h=512):
    th = (np.arange(h) + .5) * np.pi / h
    ph = np.pi - (np.arange(w) + .5) * 2 * np.pi / w
    t, p = np.meshgrid(th, ph, indexing="ij")
    d = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    omega = np.sin(t) * (np.pi / h) * (2 * np.pi / w)
    img = np.zeros((h, w, 3), np.float32)
    for l in set_:
        r = np.radians(max(l["radius_deg"], 0.6))
        m = d @ np.array(l["direction"]) >= np.cos(r)
        img[m] += np.array(l["irradiance"]) / omega[m].sum()
    return img

def scene(kind):
    s = {"type": "scene", "integrator": {"type": "path", "max_depth": 3, "hide_emitters": True},
         "sensor": {"type": "perspective", "fov": 32, "to_world": T().look_at([3.4, 2.3, 4.2], [0, .5, 0], [0, 1, 0]),
                    "film": {"type": "hdrfilm", "width": 300, "height": 225}, "sampler": {"type": "independent", "sample_count": 128}},
         "floor": {"type": "disk", "to_world": T().rotate([1, 0, 0], -90).scale(6), "bsdf": {"type": "diffuse", "reflectance": .5}},
         "ball": {"type": "sphere", "center": [-.5, .6, 0], "radius": .6, "bsdf": {"type": "diffuse", "reflectance": .6}},
         "box": {"type": "cube", "to_world": T().translate([.9, .4, .3]).rotate([0, 1, 0], 25).scale(.4), "bsdf": {"type": "diffuse", "reflectance": .6}}}
    if kind == "map":
        img = np.maximum(np.nan_to_num(np.array(mi.Bitmap(env).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32))), 0)
    elif kind == "discs":
        img = disc_map(lights(discs))
    if kind == "points":
        for i, l in enumerate(lights(points)):
            s[f"l{i}"] = {"type": "directional", "direction": [-v for v in yup(l["direction"])], "irradiance": {"type": "rgb", "value": l["irradiance"]}}
    else:
        # Column 0 of the map is at phi = pi of the probe; Mitsuba's map begins at -Z and has the opposite direction of rotation about +Y.
        s["env"] = {"type": "envmap", "bitmap": mi.Bitmap(img), "to_world": T().rotate([0, 1, 0], float(sys.argv[5]) if len(sys.argv) > 5 else 90)}
    return mi.load_dict(s)

images = [np.array(mi.render(scene(k))) for k in ("map", "points", "discs")]
scale = .5 / images[0].mean()
for k, i in zip(("points", "discs"), images[1:]):
    print(k, "relative RMS against the map: %.4f" % (np.sqrt(((i - images[0]) ** 2).mean()) / images[0].mean()))
mi.Bitmap(np.concatenate(images, 1) * scale).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, srgb_gamma=True).write(out)
