"""Sun lights that show a light set. A sun keeps the id of its light for as long as the light exists."""

import math

import bpy
from mathutils import Quaternion, Vector

COLLECTION = "hemilux"
ID = "hemilux_id"
DARK = ""


def collection_of(scene):
    """Returns the collection of the suns in `scene`; creates it if it is missing."""
    for child in scene.collection.children:
        if child.get(COLLECTION):
            return child
    made = bpy.data.collections.new(COLLECTION)
    made[COLLECTION] = True
    scene.collection.children.link(made)
    return made


def suns_of(collection):
    return [o for o in collection.objects if o.type == "LIGHT" and ID in o]


def add_sun(collection):
    data = bpy.data.lights.new("hemilux", "SUN")
    data.energy = 0.0
    sun = bpy.data.objects.new("hemilux", data)
    sun.rotation_mode = "QUATERNION"
    sun[ID] = DARK
    collection.objects.link(sun)
    return sun


def resize(collection, count):
    """Adds or removes suns until there are `count`; suns without a light are removed first."""
    suns = sorted(suns_of(collection), key=lambda sun: sun[ID] == DARK)
    for sun in suns[count:]:
        bpy.data.lights.remove(sun.data)
    for _ in range(len(suns), count):
        add_sun(collection)


def brightness(light):
    r, g, b = light["irradiance"]
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def show(collection, lights, exposure, soft=True):
    """Shows the brightest of `lights`, one sun each, and returns the suns whose light changed to another id."""
    suns = suns_of(collection)
    shown = {str(light["id"]): light for light in sorted(lights, key=brightness, reverse=True)[: len(suns)]}
    held = {sun[ID]: sun for sun in suns if sun[ID] in shown}
    free = [sun for sun in suns if sun[ID] not in shown]
    changed = []
    for name, light in shown.items():
        sun = held.get(name)
        if sun is None:
            sun = free.pop(0)
            sun[ID] = name
            changed.append(sun)
        shine(sun, light, exposure, soft)
    for sun in free:
        if sun[ID] != DARK:
            changed.append(sun)
        sun[ID] = DARK
        sun.data.energy = 0.0
    return changed


def shine(sun, light, exposure, soft):
    """Sets a sun's energy, the irradiance of a surface that faces the sun: for a disc, its irradiance times (1 + cos r) / 2. Without `soft` the sun is a point."""
    radius = math.radians(light["radius_deg"]) if soft else 0.0
    top = max(light["irradiance"])
    data = sun.data
    data.energy = top * exposure * (1.0 + math.cos(radius)) / 2.0
    data.color = [v / top for v in light["irradiance"]] if top > 0.0 else (1.0, 1.0, 1.0)
    data.angle = 2.0 * radius
    turn(sun, Vector(light["direction"]))


def turn(sun, towards):
    """Rotates the sun by the smallest angle so that its +Z, opposite to its direction of light, points `towards` the light."""
    if towards.length < 1e-6:
        return
    now = sun.rotation_quaternion @ Vector((0.0, 0.0, 1.0))
    turned = now.rotation_difference(towards) @ sun.rotation_quaternion
    sun.rotation_quaternion = Quaternion(turned).normalized()


def forget(collection):
    """Clears the ids of all suns: ids of another run of the probe belong to other lights."""
    for sun in suns_of(collection):
        sun[ID] = DARK
        sun.data.energy = 0.0


def key(collection, frame, changed):
    """Inserts keyframes of all suns at `frame`. For a sun that shows another light from this frame, the earlier values stay constant up to it."""
    for sun in suns_of(collection):
        if sun in changed:
            hold(sun)
            hold(sun.data)
        sun.keyframe_insert("rotation_quaternion", frame=frame)
        for name in ("energy", "color", "angle"):
            sun.data.keyframe_insert(name, frame=frame)


def curves_of(item):
    """Returns the animation curves of `item`: those of its action's slot in Blender 4.4 and later, those of its action in earlier versions."""
    data = item.animation_data
    if not data or not data.action:
        return []
    if not hasattr(data.action, "layers") or not data.action.layers:
        return getattr(data.action, "fcurves", [])
    bags = (strip.channelbag(data.action_slot) for layer in data.action.layers for strip in layer.strips)
    return [curve for bag in bags if bag for curve in bag.fcurves]


def hold(item):
    for curve in curves_of(item):
        if curve.keyframe_points:
            curve.keyframe_points[-1].interpolation = "CONSTANT"
