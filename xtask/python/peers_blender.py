"""Blender's cloth on the moving skirt: `peers_blender.py SCENE OUT.npz QUALITY,COLLISIONS`.

Self-collision is on. A frame's time is that of stepping the scene on by one frame; the first step
holds what Blender needs to get ready and stands for the start.
"""

import sys

import bpy
import numpy as np

from peers_scene import Clock, Scene, write

# Blender counts time in frames of this many seconds, whatever the frame rate.
FRAME = 0.001**0.5
# Mass of a vertex [kg] in Blender's own presets, which its damping figures belong to. All else is
# scaled by the mass that a vertex should have, so that the motion is that of the true masses.
MASS = 0.3
# What Blender's bending figure, next to a vertex of 0.3 kg, times the square of a triangle's mean
# height is to `B`: measured by cantilevers of 5 cm against the elastica.
BENDS = 22.0
# Least distance that a collider of Blender's can add to the cloth's own [m].
OUTER = 1e-3


def turned(points):
    """Y up becomes Z up."""
    return np.stack([points[..., 0], -points[..., 2], points[..., 1]], axis=-1)


def back(points):
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def thing(name, points, faces):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(turned(points).tolist(), [], faces.tolist())
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    return made


def moves(made, scene):
    """One key a frame; the start is frame 1."""
    made.rotation_mode = "QUATERNION"
    for k in range(scene.frames + 1):
        x, y, z, w = scene.turns[k]
        made.location = turned(scene.ways[k])
        made.rotation_quaternion = (w, x, -z, y)
        made.keyframe_insert("location", frame=k + 1)
        made.keyframe_insert("rotation_quaternion", frame=k + 1)


def spring(scene):
    """Stiffness of every edge [N/m] for the sheet's along the length, and the mean edge [m]."""
    flat, areas = scene.flat(), scene.areas()
    edges = np.concatenate([flat[:, (k + 1) % 3] - flat[:, k] for k in range(3)])
    squares = edges**2
    # Two faces share an edge; the few of the rims count half.
    energy = 0.5 * (squares.T / np.maximum(squares.sum(axis=1), 1e-12)) @ squares / areas.sum()
    (across, both), (_, along) = energy
    long = np.sqrt(squares.sum(axis=1)).mean()
    return scene.material["stretch_n_m"] / (along - both**2 / across), long


def dress(made, scene, quality, collisions):
    """The reference material in Blender's units."""
    m = scene.material
    made.vertex_groups.new(name="waist").add(scene.pinned.tolist(), 1.0, "REPLACE")
    cloth = made.modifiers.new("cloth", "CLOTH")
    s, c = cloth.settings, cloth.collision_settings
    true_mass = m["density_kg_m2"] * scene.areas().sum() / len(scene.cloth)
    scale = MASS / true_mass * FRAME**2
    stiffness, long = spring(scene)
    s.quality, s.mass, s.time_scale = quality, MASS, 1 / (scene.fps * FRAME)
    s.tension_stiffness = s.compression_stiffness = scale * stiffness * long
    s.bending_model, s.bending_stiffness = "ANGULAR", scale * bending(scene)
    s.air_damping = 0.0
    s.vertex_group_mass = "waist"
    cloth.point_cache.frame_start, cloth.point_cache.frame_end = 1, scene.frames + 1
    c.collision_quality = collisions
    # Its friction is in hundredths.
    c.distance_min, c.friction = m["apart_m"] - OUTER, 100 * m["friction"]
    c.use_self_collision = True
    c.self_distance_min, c.self_friction = m["apart_m"], 100 * m["friction"]
    return s


def bending(scene):
    """The figure that bends like the sheet, in a triangle of mean area on a mean edge."""
    _, long = spring(scene)
    height = 2 * scene.areas().mean() / long
    return BENDS * scene.material["bend_n_m"] / height**2


def block(made, scene):
    made.modifiers.new("collision", "COLLISION")
    made.collision.thickness_outer = OUTER
    made.collision.cloth_friction = 100 * scene.material["friction"]


def seen(made):
    """Where the cloth is now, Y up [m]."""
    now = made.evaluated_get(bpy.context.evaluated_depsgraph_get())
    flat = np.empty(3 * len(now.data.vertices), dtype=np.float32)
    now.data.vertices.foreach_get("co", flat)
    world = np.array(now.matrix_world)
    return back(flat.reshape(-1, 3).astype(float) @ world[:3, :3].T + world[:3, 3])


def run(scene, quality, collisions, change=lambda settings: None):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    stage = bpy.context.scene
    stage.render.fps, stage.render.fps_base = int(scene.fps), 1.0
    stage.gravity = turned(np.array(scene.gravity)).tolist()
    stage.frame_start, stage.frame_end = 1, scene.frames + 1
    body = thing("body", scene.body, scene.body_faces)
    cloth = thing("cloth", scene.cloth, scene.faces)
    block(body, scene)
    change(dress(cloth, scene, quality, collisions))
    moves(body, scene)
    moves(cloth, scene)
    stage.frame_set(1)
    clock, frames = Clock(), [seen(cloth)]
    for k in range(scene.frames):
        with clock:
            stage.frame_set(k + 2)
        frames.append(seen(cloth))
    return clock, frames


def main(folder, out, setting):
    quality, collisions = (int(x) for x in setting.split(","))
    scene = Scene(folder)
    clock, frames = run(scene, quality, collisions)
    write(out, scene, frames, clock, {"blender": bpy.app.version_string})


if __name__ == "__main__":
    main(*sys.argv[1:4])
