"""Prints one JSON line a file: what trimesh finds in it, node by node, in world coordinates."""

import json
import sys

import numpy as np
import trimesh

for path in sys.argv[1:]:
    scene = trimesh.load(path, process=False, force="scene")
    nodes = {}
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        mesh = scene.geometry[name]
        verts = trimesh.transform_points(mesh.vertices, matrix)
        assert np.isfinite(verts).all() and np.isfinite(mesh.vertex_normals).all()
        nodes[node] = {
            "verts": len(verts),
            "faces": len(mesh.faces),
            "min": verts.min(axis=0).tolist(),
            "max": verts.max(axis=0).tolist(),
        }
    print(json.dumps({"file": path, "nodes": nodes}))
