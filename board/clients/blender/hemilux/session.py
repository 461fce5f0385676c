"""The connection of a scene to a probe. `step` is called by a timer of Blender's main thread."""

import bpy

from . import feed, suns, world

# Time between two calls of `step`, seconds.
INTERVAL = 0.04


class Session:
    def __init__(self, scene):
        settings = scene.hemilux
        if not feed.is_loopback(settings.address) and not bpy.app.online_access:
            raise feed.Refused("Preferences > System > Network: found Allow Online Access off, expected it on for another machine's probe")
        self.scene_name = scene.name
        path = feed.path_of(settings.lights, world.has_ambient(settings.world), "blender", settings.soft)
        self.feed = feed.Feed(settings.address, path, settings.token)
        self.run, self.frame, self.start = None, None, None

    def scene(self):
        return bpy.data.scenes.get(self.scene_name)

    def step(self):
        """Shows the newest light set. Returns True if a new set has arrived."""
        found, scene = self.feed.take(), self.scene()
        if scene is None:
            self.feed.close()
            return False
        scene.hemilux.state = self.feed.state[:300]
        if found is None or (found["run"], found["frame"]) == (self.run, self.frame):
            return False
        self.show(scene, found)
        return True

    def show(self, scene, found):
        settings, collection = scene.hemilux, suns.collection_of(scene)
        if found["run"] != self.run:
            suns.forget(collection)
            self.start = None
        suns.resize(collection, settings.lights)
        changed = suns.show(collection, found["lights"], settings.exposure, settings.soft)
        world.show_ambient(scene, found["ambient"])
        self.run, self.frame = found["run"], found["frame"]
        if settings.record:
            self.key(scene, found, changed)
        else:
            self.start = None

    def key(self, scene, found, changed):
        """Inserts keyframes at the set's time, counted from the frame at which the recording began."""
        if self.start is None:
            self.start = (found["time_ns"], scene.frame_current)
        began, first = self.start
        frame = first + (found["time_ns"] - began) * 1e-9 * scene.render.fps / scene.render.fps_base
        suns.key(suns.collection_of(scene), frame, changed)
        if found["ambient"]:
            world.key(scene, frame)


current = None


def connect(scene):
    """Connects `scene`; raises feed.Refused with one line of reason if the connection is impossible."""
    global current
    freeze()
    current = Session(scene)
    prepare(scene)
    if not bpy.app.timers.is_registered(tick):
        bpy.app.timers.register(tick)


def prepare(scene):
    """Applies the scene's settings to the suns, the world and the map."""
    settings, collection = scene.hemilux, suns.collection_of(scene)
    suns.resize(collection, settings.lights)
    collection.hide_render = collection.hide_viewport = settings.world == "MAP"
    world.set_mode(scene, settings.world, settings.exposure)
    if settings.world in ("MAP", "BACKDROP"):
        load_map(scene)


def load_map(scene):
    try:
        world.show_map(scene, feed.map_bytes(scene.hemilux.address, scene.hemilux.token))
    except (OSError, RuntimeError, feed.Refused) as error:
        raise feed.Refused(f"map: {error}") from None


def freeze():
    """Ends the connection. Suns, world and keyframes are kept."""
    global current
    if current is None:
        return
    current.feed.close()
    scene = current.scene()
    if scene:
        scene.hemilux.state = f"frozen at frame {current.frame}" if current.frame is not None else "not connected"
    current = None


def tick():
    if current is None:
        return None
    current.step()
    return INTERVAL
