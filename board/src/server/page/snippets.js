// The panel "Use it": programs that read light sets of this probe, with its address, in the axes of each program.

/** The three.js release that the page's snippet loads. */
const THREE = "https://cdn.jsdelivr.net/npm/three@0.180.0/build/three.module.min.js";

/** For each program: a note on its requirements and effect, and its text for a probe at `base`. */
export const SNIPPETS = {
  "three.js": ["A page with a ball in this light. Save it as index.html, serve its folder (python3 -m http.server 8000), start the probe with "
    + "--allow-origin http://localhost:8000 and open that address. Axes: +Y up, right-handed.", base => `<!DOCTYPE html>
<meta charset="utf-8">
<title>In the light of a probe</title>
<style>body { margin: 0; background: #222 }</style>
<script type="importmap">{ "imports": { "three": "${THREE}" } }</script>
<script type="module">
import * as THREE from "three";
import { Hemilux } from "${base}/client.js";
import { ProbeLights } from "${base}/three.js";

const renderer = new THREE.WebGLRenderer({ antialias: true });
renderer.setSize(innerWidth, innerHeight);
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);
const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(40, innerWidth / innerHeight, 0.1, 50);
camera.position.set(0, 2.5, 6);
camera.lookAt(0, 0.7, 0);
const white = new THREE.MeshStandardMaterial({ color: 0xcccccc, roughness: 0.7 });
const ball = new THREE.Mesh(new THREE.SphereGeometry(1, 48, 24).translate(0, 1, 0), white);
const ground = new THREE.Mesh(new THREE.CircleGeometry(8, 64).rotateX(-Math.PI / 2), white);
ball.castShadow = ground.receiveShadow = true;
scene.add(ball, ground);

const probe = new Hemilux("${base}", { coordinates: "three", ambient: true, soft: true, lights: 8 });
const lights = new ProbeLights(THREE, 8, { castShadow: true, soft: true });
scene.add(lights.group);
renderer.setAnimationLoop(() => {
  // A white ground is to be white.
  const ground = probe.latest ? Math.max(...probe.latest.horizontal_irradiance) : 0;
  lights.exposure = ground > 0 ? Math.PI / ground : 1;
  lights.update(probe);
  renderer.render(scene, camera);
});
</script>
`],
  JavaScript: ["One set with fetch, in Node.js or in a page (of another site with --allow-origin). Axes: three.js, +Y up; without coordinates, the probe's own, +Z up. soft=1: lights fitted as discs of their radius.", base => `const answer = await fetch("${base}/v1/lights?coordinates=three&soft=1&lights=8");
if (!answer.ok) throw new Error(await answer.text());
const set = await answer.json();
for (const { id, direction, irradiance, radius_deg } of set.lights) {
  console.log(id, "towards", direction, "irradiance", irradiance, "radius", radius_deg, "degrees");
}
`],
  Python: ["Receives each set; needs the standard library alone. Axes: the probe's, +Z up. soft=1: lights fitted as discs of their radius.", base => `import json
import urllib.request

after = ""
for _ in range(5):  # while True: goes on
    with urllib.request.urlopen("${base}/v1/lights?soft=1&lights=8" + after, timeout=5) as answer:
        found = json.load(answer)
    after = f"&after={found['frame']}"
    print("frame", found["frame"])
    for light in found["lights"]:
        print(light["id"], "towards", light["direction"], "irradiance", light["irradiance"], "radius", light["radius_deg"], "degrees")
`],
  Rust: ["With the crate hemilux and its feature client. Axes: the probe's, +Z up; Options::coordinates selects others.", base => `use hemilux::client::{Client, ClientError, Options};
use std::time::Duration;

fn main() -> Result<(), ClientError> {
    let client = Client::connect(&Options { lights: Some(8), ..Options::new("${base}") })?;
    while let Some(set) = client.next(Duration::from_secs(2)) {
        println!("frame {}: {} lights", set.frame, set.lights.len());
    }
    Ok(())
}
`],
  curl: ["Text, JSON, and the map.", base => `curl '${base}/v1/lights?lights=8'
curl '${base}/v1/lights?format=text'
curl -o lights.glb '${base}/v1/lights?format=glb'
curl -N '${base}/v1/events?lights=8'
curl -o map.exr '${base}/v1/map.exr?width=1024'
`],
  Blender: ["Paste it into Blender's text editor (Scripting) and run it: 16 suns by their ids, with soft shadows, +Z up; run it again for a newer set. The extension in board/clients/blender updates the suns by itself.", base => `import json
import math
import urllib.request
import bpy
from mathutils import Vector

with urllib.request.urlopen("${base}/v1/lights?soft=1&lights=16", timeout=5) as answer:
    found = json.load(answer)
to_watts = 1 / 179 if found["unit"] == "lux" else 1
collection = bpy.data.collections.get("hemilux") or bpy.data.collections.new("hemilux")
if collection.name not in bpy.context.scene.collection.children:
    bpy.context.scene.collection.children.link(collection)
suns = {sun["hemilux_id"]: sun for sun in collection.objects if "hemilux_id" in sun}
for gone in set(suns) - {str(light["id"]) for light in found["lights"]}:
    bpy.data.lights.remove(suns.pop(gone).data)
for light in found["lights"]:
    id, strength, radius = str(light["id"]), max(light["irradiance"]), math.radians(light["radius_deg"])
    sun = suns.get(id)
    if sun is None:
        sun = bpy.data.objects.new(f"hemilux {id}", bpy.data.lights.new(f"hemilux {id}", "SUN"))
        sun["hemilux_id"] = id
        collection.objects.link(sun)
    sun.rotation_mode = "QUATERNION"
    sun.rotation_quaternion = Vector(light["direction"]).to_track_quat("Z", "Y")
    sun.data.energy = strength * to_watts * (1 + math.cos(radius)) / 2  # what a surface facing the disc receives
    sun.data.color = [v / strength for v in light["irradiance"]] if strength > 0 else (1, 1, 1)
    sun.data.angle = 2 * radius
`],
};

/** Fills the panel: `choice` gets one button per program, `text` and `note` show the selected one, `copy` copies the text to the clipboard. */
export function useIt({ choice, note, text, copy, told }) {
  const show = name => {
    const [about, of] = SNIPPETS[name];
    note.textContent = about;
    text.textContent = of(location.origin);
    told.textContent = "";
  };
  Object.keys(SNIPPETS).forEach((name, i) => {
    const label = document.createElement("label"), radio = Object.assign(document.createElement("input"), { type: "radio", name: "snippet", value: name, checked: i === 0 });
    radio.addEventListener("change", () => show(name));
    label.append(radio, Object.assign(document.createElement("span"), { textContent: name }));
    choice.append(label);
  });
  copy.addEventListener("click", async () => {
    // Only pages of this machine or over TLS may write to the clipboard; on others the text is selected for Ctrl+C.
    try {
      await navigator.clipboard.writeText(text.textContent);
      told.textContent = "Copied.";
    } catch {
      getSelection().selectAllChildren(text);
      told.textContent = "Marked: press Ctrl+C.";
    }
  });
  show(Object.keys(SNIPPETS)[0]);
}
