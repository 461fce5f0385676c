"""The world of a scene: ambient light as spherical harmonics, the probe's map, or both."""

import os
import tempfile

import bpy

NAME = "hemilux"
MODES = [
    ("NONE", "Suns only", "A black world. All light is in the suns"),
    ("AMBIENT", "Suns and ambient", "Diffuse light is in the world as nine spherical harmonics, all other light in the suns"),
    ("BACKDROP", "Map behind suns", "The map is visible to the camera. The suns and the ambient light illuminate the scene"),
    ("MAP", "Map only", "The map illuminates the scene, and the suns are hidden: the reference for the suns"),
]
# Constants of the real orthonormal harmonics, order (0,0) (1,-1) (1,0) (1,1) (2,-2) (2,-1) (2,0) (2,1) (2,2).
K1, K2 = 0.4886025119, 1.0925484306
CONSTANTS = [0.2820947918, K1, K1, K1, K2, K2, 0.3153915653, K2, 0.5462742153]


def has_ambient(mode):
    return mode in ("AMBIENT", "BACKDROP")


def world_of(scene):
    """Returns the scene's hemilux world; creates it if it is missing. The user's world is replaced, not deleted."""
    if scene.world and scene.world.get(NAME):
        return scene.world
    world = bpy.data.worlds.new(NAME)
    world[NAME] = True
    world.use_nodes = True
    build(world.node_tree)
    scene.world = world
    return world


def build(tree):
    tree.nodes.clear()
    node = tree.nodes.new
    output, mix, path = node("ShaderNodeOutputWorld"), node("ShaderNodeMixShader"), node("ShaderNodeLightPath")
    ambient, picture = node("ShaderNodeBackground"), node("ShaderNodeBackground")
    texture = node("ShaderNodeTexEnvironment")
    mix.name, ambient.name, picture.name, texture.name = "mix", "ambient", "picture", "map"
    path.name = "path"
    tree.links.new(harmonics(tree), ambient.inputs["Color"])
    tree.links.new(texture.outputs["Color"], picture.inputs["Color"])
    tree.links.new(ambient.outputs[0], mix.inputs[1])
    tree.links.new(picture.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], output.inputs["Surface"])


class Maths:
    """Creates the shader nodes of an expression; operands and results are sockets."""

    def __init__(self, tree):
        self.tree = tree

    def node(self, kind, operation, *inputs):
        made = self.tree.nodes.new(kind)
        made.operation = operation
        for place, value in enumerate(inputs):
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, made.inputs[place])
            else:
                made.inputs[place].default_value = value
        return made.outputs[0]

    def number(self, operation, *inputs):
        return self.node("ShaderNodeMath", operation, *inputs)

    def vector(self, operation, *inputs):
        return self.node("ShaderNodeVectorMath", operation, *inputs)


def harmonics(tree):
    """Returns a socket with the radiance, in the direction of a ray, of the harmonics `sh0` to `sh8`, vectors of red, green and blue."""
    maths, place = Maths(tree), tree.nodes.new("ShaderNodeTexCoord")
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(place.outputs["Generated"], split.inputs[0])
    x, y, z = split.outputs
    product = lambda a, b: maths.number("MULTIPLY", a, b)
    zz = maths.number("MULTIPLY_ADD", product(z, z), 3.0, -1.0)
    xx_yy = maths.number("SUBTRACT", product(x, x), product(y, y))
    total = None
    for index, basis in enumerate([None, y, z, x, product(x, y), product(y, z), zz, product(x, z), xx_yy]):
        row = tree.nodes.new("ShaderNodeCombineXYZ")
        row.name = f"sh{index}"
        term = row.outputs[0]
        if basis is not None:
            copies = tree.nodes.new("ShaderNodeCombineXYZ")
            for socket in copies.inputs:
                tree.links.new(basis, socket)
            term = maths.vector("MULTIPLY", term, copies.outputs[0])
        total = term if total is None else maths.vector("ADD", total, term)
    return maths.vector("MAXIMUM", total, (0.0, 0.0, 0.0))


def set_mode(scene, mode, exposure):
    """Sets the world's links and strengths for one of `MODES`."""
    tree = world_of(scene).node_tree
    mix, path = tree.nodes["mix"], tree.nodes["path"]
    for link in list(mix.inputs[0].links):
        tree.links.remove(link)
    mix.inputs[0].default_value = 1.0 if mode == "MAP" else 0.0
    if mode == "BACKDROP":
        tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.nodes["ambient"].inputs["Strength"].default_value = exposure if has_ambient(mode) else 0.0
    tree.nodes["picture"].inputs["Strength"].default_value = exposure


def show_ambient(scene, rows):
    """Sets the harmonics to nine rows of red, green and blue; to zero without rows."""
    nodes = world_of(scene).node_tree.nodes
    for index, constant in enumerate(CONSTANTS):
        for socket, value in zip(nodes[f"sh{index}"].inputs, rows[index] if rows else (0.0, 0.0, 0.0)):
            socket.default_value = value * constant


def key(scene, frame):
    nodes = world_of(scene).node_tree.nodes
    for index in range(len(CONSTANTS)):
        for socket in nodes[f"sh{index}"].inputs:
            socket.keyframe_insert("default_value", frame=frame)


def show_map(scene, data):
    """Sets the world's texture to the Radiance HDR map in `data`, whose axes are Blender's."""
    node = world_of(scene).node_tree.nodes["map"]
    handle, path = tempfile.mkstemp(suffix=".hdr", dir=bpy.app.tempdir or None)
    with os.fdopen(handle, "wb") as file:
        file.write(data)
    try:
        image = bpy.data.images.load(path)
        # A packed map is part of the Blender file, so that the temporary file can be removed.
        image.pack()
    finally:
        os.unlink(path)
    image.name = NAME
    old, node.image = node.image, image
    if old and old.users == 0:
        bpy.data.images.remove(old)
