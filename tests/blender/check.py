"""Tests the Blender extension against running probes: see `check.sh`."""

import argparse
import contextlib
import math
import os
import pathlib
import re
import signal
import struct
import subprocess
import sys
import time

import bpy  # isort: skip: it makes Blender's other modules known
import addon_utils
import numpy as np
from mathutils import Vector

# Largest RMSE of a picture under the suns, relative to the mean of the picture under the map.
PICTURE_ERROR = 0.06
SUNS, SAMPLES, SIZE = 16, 192, (96, 72)
# Path of the lamp: number of compared frames, frames per turn, angle from the zenith, largest distance of its sun (degrees).
FRAMES, TURN, HEIGHT_DEG, LAMP_ERROR_DEG = 100, 720, 50.0, 1.0
failures = []


def check(holds, text):
    print(f"  {'ok  ' if holds else 'FAIL'} {text}", flush=True)
    if not holds:
        failures.append(text)


@contextlib.contextmanager
def probe(program, source, *more):
    """A running probe and its address."""
    command = [program, "serve", "--source", source, "--listen", "127.0.0.1:0", *more]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            line = process.stdout.readline()
            found = re.search(r"http://[^/ ]+", line)
            assert found, f"{command}: found '{line}', expected an address"
            yield found.group()
        finally:
            process.send_signal(signal.SIGTERM)


class Extension:
    """The installed extension and the scene that it lights."""

    def __init__(self, name):
        self.session = sys.modules[name + ".session"]
        self.suns = sys.modules[name + ".suns"]
        self.world = sys.modules[name + ".world"]
        self.scene = bpy.context.scene

    def connect(self, address, mode, suns=SUNS):
        settings = self.scene.hemilux
        settings.address, settings.world, settings.lights = address, mode, suns
        assert bpy.ops.hemilux.connect() == {"FINISHED"}, settings.state

    def step(self, seconds=20.0):
        """Waits for the next set and applies it to the scene, as the timer does."""
        end = time.monotonic() + seconds
        while not self.session.current.step():
            assert time.monotonic() < end, f"no set: {self.scene.hemilux.state}"
            time.sleep(0.002)

    def lit(self):
        return [sun for sun in self.suns.suns_of(self.suns.collection_of(self.scene)) if sun.data.energy > 0.0]


def install(archive):
    """Installs the zip as Blender's preferences do; returns the module's name."""
    bpy.ops.extensions.package_install_files(filepath=str(archive), repo="user_default", enable_on_install=True)
    name = "bl_ext.user_default.hemilux"
    check(addon_utils.check(name)[1], f"{name} is installed from the zip and enabled")
    return name


def plain_scene():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.max_bounces = 4
    scene.cycles.sample_clamp_indirect = 0.0
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.render.resolution_percentage = 100
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.image_settings.color_depth = "32"
    scene.view_settings.view_transform = "Raw"
    scene.view_settings.look = "None"
    return scene


def diffuse(name, rgb):
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    output, bsdf = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfDiffuse")
    bsdf.inputs["Color"].default_value = (*rgb, 1.0)
    material.node_tree.links.new(bsdf.outputs[0], output.inputs[0])
    return material


def body(add, rgb, **where):
    add(**where)
    bpy.context.object.data.materials.append(diffuse("body", rgb))


def camera(place, towards, orthographic=None):
    data = bpy.data.cameras.new("camera")
    made = bpy.data.objects.new("camera", data)
    bpy.context.scene.collection.objects.link(made)
    made.location = place
    made.rotation_euler = (Vector(towards) - Vector(place)).to_track_quat("-Z", "Y").to_euler()
    if orthographic:
        data.type, data.ortho_scale = "ORTHO", orthographic
    else:
        data.angle = math.radians(38)
    bpy.context.scene.camera = made


def still_life():
    mesh = bpy.ops.mesh
    body(mesh.primitive_plane_add, (0.6, 0.6, 0.6), size=60)
    body(mesh.primitive_uv_sphere_add, (0.8, 0.8, 0.8), segments=64, ring_count=32, radius=1.0, location=(-1.2, -0.2, 1.0))
    body(mesh.primitive_uv_sphere_add, (0.7, 0.25, 0.2), segments=64, ring_count=32, radius=0.45, location=(0.5, -1.6, 0.45))
    body(mesh.primitive_cube_add, (0.2, 0.35, 0.7), size=1.2, location=(1.7, 0.4, 0.6), rotation=(0, 0, 0.5))
    camera((0, -7, 7), (0, 0, 0.3))


def rendered(work, seed, samples=SAMPLES):
    """Renders the scene and returns the picture in linear radiance, by way of a file."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.render.filepath = str(work / "picture.exr")
    with quiet():
        bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    image.colorspace_settings.name = "Non-Color"
    pixels = np.array(image.pixels[:], dtype=np.float64).reshape(-1, 4)[:, :3]
    bpy.data.images.remove(image)
    return pixels


@contextlib.contextmanager
def quiet():
    """Discards the lines that Blender writes to stdout."""
    sys.stdout.flush()
    kept, sink = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(sink)


def planes(extension, work):
    """Checks that a white plane that faces a sun has the radiance E (1 + cos r) / 2 / pi for any angular radius r."""
    plain_scene()
    extension.scene = bpy.context.scene
    body(bpy.ops.mesh.primitive_plane_add, (1, 1, 1), size=10)
    camera((0, 0, 5), (0, 0, 0), orthographic=1.0)
    extension.scene.cycles.max_bounces = 1
    collection = extension.suns.collection_of(extension.scene)
    extension.suns.resize(collection, 1)
    extension.world.set_mode(extension.scene, "NONE", 1.0)
    for radius in (0.0, 2.0, 15.0, 40.0):
        light = {"id": 1, "direction": [0, 0, 1], "irradiance": [3.0, 2.0, 0.5], "radius_deg": radius}
        extension.suns.show(collection, [light], 2.0)
        found = np.pi * rendered(work, 1, 64).mean(axis=0)
        expected = 2.0 * np.array(light["irradiance"]) * (1 + math.cos(math.radians(radius))) / 2
        error = np.abs(found / expected - 1).max()
        check(error < 0.015, f"a white plane under a sun of radius {radius} degrees: irradiance off by {100 * error:.2f} %")
    harmonics(extension, work, collection)


def harmonics(extension, work, collection):
    """Checks the irradiance under harmonics against the closed form of Ramamoorthi and Hanrahan: factors pi, 2 pi / 3, pi / 4 by degree."""
    extension.suns.show(collection, [], 1.0)
    extension.world.set_mode(extension.scene, "AMBIENT", 1.0)
    # The radiance 1 + y / 2 + (3 z^2 - 1) / 4 is positive everywhere.
    rows = [[0.0] * 3 for _ in range(9)]
    rows[0], rows[1], rows[6] = [v / 0.28209479 for v in (1, 1, 1)], [0.5 / 0.48860251] * 3, [0.25 / 0.31539157] * 3
    extension.world.show_ambient(extension.scene, rows)
    for turn, normal in (((0, 0, 0), (0, 0, 1)), ((-math.pi / 4, 0, 0), (0, math.sqrt(0.5), math.sqrt(0.5)))):
        plane = next(o for o in bpy.context.scene.objects if o.type == "MESH")
        plane.rotation_euler = turn
        view = bpy.context.scene.camera
        view.location = [5 * v for v in normal]
        view.rotation_euler = Vector(normal).to_track_quat("Z", "Y").to_euler()
        expected = math.pi + 2 * math.pi / 3 * 0.5 * normal[1] + math.pi / 4 * 0.25 * (3 * normal[2] ** 2 - 1)
        found = np.pi * rendered(work, 1, 1024).mean(axis=0)
        error = np.abs(found / expected - 1).max()
        check(error < 0.01, f"a white plane with normal {normal} under harmonics: irradiance off by {100 * error:.2f} %")


def pictures(extension, program, source, work):
    """Compares pictures by the mean product of two independent differences: the mean squared error without the noise of the path tracer."""
    plain_scene()
    still_life()
    extension.scene = bpy.context.scene
    with probe(program, source) as address:
        found = []
        for mode in ("MAP", "NONE"):
            extension.connect(address, mode)
            extension.step()
            bpy.ops.hemilux.freeze()
            found.append([rendered(work, seed) for seed in (1, 2)])
    (reference, again), (suns, suns_again) = found
    mean = (reference.mean() + again.mean()) / 2
    error = math.sqrt(max(0.0, ((suns - reference) * (suns_again - again)).mean())) / mean
    noise = math.sqrt(((suns - suns_again) ** 2 + (reference - again) ** 2).mean() / 4) / mean
    bias = (suns.mean() + suns_again.mean()) / 2 / mean - 1
    text = f"RMSE {100 * error:.2f} % of the mean beside {100 * noise:.2f} % of noise; means differ by {100 * bias:+.2f} %"
    check(error <= PICTURE_ERROR, f"{source}: a picture under the map and under {SUNS} suns: {text}")


def lamp_direction(step, height_deg=HEIGHT_DEG):
    theta, phi = math.radians(height_deg), 2 * math.pi * step / TURN
    return np.array([math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)])


def lamp_frames(path, size=160):
    """Writes fisheye pictures of 180 degrees to a pipe's file: a lamp of 6 degrees radius turns round the axis among three dimmer lamps."""
    rows, columns = np.mgrid[0:size, 0:size]
    x, y = columns - (size - 1) / 2, rows - (size - 1) / 2
    theta = np.hypot(x, y) / (size / 2) * math.pi / 2
    phi = np.arctan2(y, x)
    directions = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)
    with open(path, "wb") as file:
        for step in range(TURN // 2):
            places = [(lamp_direction(step), 200)] + [(lamp_direction(*place), 100) for place in ((250, 60), (400, 35), (550, 55))]
            edge = math.cos(math.radians(6.0))
            lit = sum(code * np.clip((directions @ towards - edge) / 0.0005 + 0.5, 0, 1) for towards, code in places)
            rgb = (1 + lit[..., None] * np.array([1.0, 0.8, 0.5])).astype(np.uint8).tobytes()
            head = struct.pack("<4sHH4sIIIIHHQQddd", b"HLXF", 1, 72, b"RGB3", size, size, 0, len(rgb), 0, 1, step, 0, 0.01, 1.0, 0.0)
            file.write(head + rgb)


def renamed(before, after):
    """Returns the number of lights that disappeared and have a successor of another id within 5 degrees."""
    gone = [towards for name, towards in before.items() if name not in after]
    new = [towards for name, towards in after.items() if name not in before]
    return sum(a.angle(b) < math.radians(5) for a in gone for b in new)


def moving_lamp(extension, program, work):
    plain_scene()
    extension.scene = scene = bpy.context.scene
    scene.hemilux.record = True
    lamp_frames(work / "lamp.pipe")
    seen, angles = [], []
    with probe(program, f"pipe:{work / 'lamp.pipe'}") as address:
        extension.connect(address, "AMBIENT", suns=4)
        for _ in range(FRAMES):
            extension.step()
            seen.append({sun["hemilux_id"]: sun.rotation_quaternion @ Vector((0, 0, 1)) for sun in extension.lit()})
            lamp = max(extension.lit(), key=lambda sun: sun.data.energy)
            towards = np.array(lamp.rotation_quaternion @ Vector((0, 0, 1)))
            height = math.degrees(math.acos(np.clip(towards[2], -1, 1)))
            angles.append((lamp.name, math.atan2(towards[1], towards[0]), height))
        bpy.ops.hemilux.freeze()
    names = {name for name, _, _ in angles}
    check(len(names) == 1, f"moving lamp: one sun follows it over {FRAMES} frames ({sorted(names)})")
    changes = sum(renamed(before, after) for before, after in zip(seen, seen[1:]))
    check(changes == 0, f"moving lamp: {changes} changes of a light's id over {FRAMES} frames")
    off = max(abs(height - HEIGHT_DEG) for _, _, height in angles)
    steps = np.angle(np.exp(1j * np.diff([phi for _, phi, _ in angles])))
    turned = math.degrees(steps.sum())
    check(off < LAMP_ERROR_DEG, f"moving lamp: {off:.2f} degrees off its circle at most")
    least = 0.9 * 360 * FRAMES / TURN
    check(turned > least, f"moving lamp: it turns by {turned:.0f} degrees in +X to +Y (expected more than {least:.0f})")
    keyframes(extension, scene, next(iter(names)))


def keyframes(extension, scene, name):
    sun = bpy.data.objects[name]
    curves = extension.suns.curves_of(sun)
    counts = {len(curve.keyframe_points) for curve in curves}
    check(len(curves) == 4 and min(counts) >= FRAMES, f"keyframes: {len(curves)} curves of the lamp's rotation with {counts} keys")
    last = curves[0].keyframe_points[-1].co[0]
    expected = FRAMES / 10 * scene.render.fps
    check(0.8 * expected < last < 1.6 * expected, f"keyframes: {last:.0f} frames for ten seconds and a bit at {scene.render.fps} Hz")
    scene.frame_set(int(last / 2))
    off = abs(math.degrees(math.acos((sun.rotation_quaternion @ Vector((0, 0, 1))).z)) - HEIGHT_DEG)
    check(off < LAMP_ERROR_DEG, f"keyframes: played back, the lamp is {off:.2f} degrees off its circle")


def wrong_addresses(extension):
    """Checks that an address without a probe gives one line of error."""
    plain_scene()
    extension.scene = bpy.context.scene
    settings = extension.scene.hemilux
    for address, named in (("http://127.0.0.1:9", "no answer"), ("ftp://x", "expected http://HOST:PORT"), ("http://192.0.2.1", "Allow Online Access")):
        settings.address, settings.world = address, "NONE"
        try:
            bpy.ops.hemilux.connect()
            time.sleep(0.4)
            extension.session.current.step()
        except RuntimeError:
            pass
        state = settings.state
        check(named in state and "\n" not in state, f"{address}: {state}")
        bpy.ops.hemilux.freeze()


def main():
    parser = argparse.ArgumentParser()
    for name in ("program", "zip", "work"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("sources", nargs="+")
    options = parser.parse_args()
    extension = Extension(install(options.zip))
    wrong_addresses(extension)
    planes(extension, options.work)
    moving_lamp(extension, options.program, options.work)
    for source in options.sources:
        pictures(extension, options.program, source, options.work)
    print(f"blender: {'failed' if failures else 'passed'}")
    sys.stdout.flush()
    sys.exit(1 if failures else 0)


main()
