"""Shows the light sets of a hemilux light probe as sun lights, ambient light and the world of a scene."""

import bpy
from bpy.app.handlers import persistent

from . import feed, session, world


def changed(self, _context):
    """Applies a changed setting of the connection at once."""
    scene = self.id_data
    if session.current is None or session.current.scene() != scene:
        return
    try:
        session.connect(scene)
    except feed.Refused as error:
        scene.hemilux.state = str(error)[:300]


class HemiluxSettings(bpy.types.PropertyGroup):
    address: bpy.props.StringProperty(name="Probe", default="http://127.0.0.1:8080", description="Address of the probe, http://HOST:PORT")
    token: bpy.props.StringProperty(
        name="Token", subtype="PASSWORD", options={"SKIP_SAVE"}, description="Token of a probe on the network. The map needs it. Not saved"
    )
    lights: bpy.props.IntProperty(name="Suns", default=16, min=1, max=256, update=changed, description="Largest number of sun lights")
    soft: bpy.props.BoolProperty(
        name="Soft", default=True, update=changed, description="Lights fitted as discs, whose diameters are the suns' angles. Off: points with hard shadows"
    )
    exposure: bpy.props.FloatProperty(
        name="Exposure", default=1.0, min=0.0, soft_max=10.0, update=changed, description="Factor of all irradiances and radiances"
    )
    world: bpy.props.EnumProperty(name="World", items=world.MODES, default="AMBIENT", update=changed)
    record: bpy.props.BoolProperty(name="Record keyframes", description="Insert keyframes for each light set, in real time from the current frame")
    state: bpy.props.StringProperty(default="not connected", options={"SKIP_SAVE"})


class HemiluxConnect(bpy.types.Operator):
    """Follow the probe"""

    bl_idname, bl_label = "hemilux.connect", "Connect"

    def execute(self, context):
        try:
            session.connect(context.scene)
        except feed.Refused as error:
            session.freeze()
            context.scene.hemilux.state = str(error)[:300]
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class HemiluxFreeze(bpy.types.Operator):
    """End the connection. Lights, world and keyframes are kept"""

    bl_idname, bl_label = "hemilux.freeze", "Freeze"

    def execute(self, _context):
        session.freeze()
        return {"FINISHED"}


class HemiluxMap(bpy.types.Operator):
    """Load the probe's newest map into the world"""

    bl_idname, bl_label = "hemilux.map", "Refresh map"

    def execute(self, context):
        try:
            session.load_map(context.scene)
        except feed.Refused as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


class HemiluxKey(bpy.types.Operator):
    """Insert keyframes of the present lights at the current frame"""

    bl_idname, bl_label = "hemilux.key", "Keyframe now"

    def execute(self, context):
        from . import suns

        suns.key(suns.collection_of(context.scene), context.scene.frame_current, ())
        world.key(context.scene, context.scene.frame_current)
        return {"FINISHED"}


class HemiluxPanel(bpy.types.Panel):
    bl_idname, bl_label = "VIEW3D_PT_hemilux", "hemilux"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "hemilux"

    def draw(self, context):
        settings, column = context.scene.hemilux, self.layout.column()
        for name in ("address", "token", "lights", "soft", "exposure", "world", "record"):
            column.prop(settings, name)
        row = column.row()
        row.operator("hemilux.connect" if session.current is None else "hemilux.freeze")
        row.operator("hemilux.key")
        if settings.world in ("MAP", "BACKDROP"):
            column.operator("hemilux.map")
        column.label(text=settings.state)


@persistent
def before_load(*_):
    session.freeze()


CLASSES = (HemiluxSettings, HemiluxConnect, HemiluxFreeze, HemiluxMap, HemiluxKey, HemiluxPanel)


def register():
    for kind in CLASSES:
        bpy.utils.register_class(kind)
    bpy.types.Scene.hemilux = bpy.props.PointerProperty(type=HemiluxSettings)
    bpy.app.handlers.load_pre.append(before_load)


def unregister():
    session.freeze()
    bpy.app.handlers.load_pre.remove(before_load)
    del bpy.types.Scene.hemilux
    for kind in reversed(CLASSES):
        bpy.utils.unregister_class(kind)
