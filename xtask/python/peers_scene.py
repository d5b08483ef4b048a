"""The scene of `muslin bench cloth --peers` as arrays, and a run of it as a file.

Metres, Y up, one triangle mesh of cloth and one of a rigid body, as `scene.json` names them.
"""

import json
import pathlib
import time

import numpy as np


class Scene:
    """What everybody simulates."""

    def __init__(self, folder):
        folder = pathlib.Path(folder)
        told = json.loads((folder / "scene.json").read_text())
        self.frames = told["frames"]
        self.fps = told["frames_per_second"]
        self.gravity = told["gravity"]
        self.material = told["material"]
        self.pinned = np.array(told["pinned"], dtype=np.int32)
        self.cloth, self.faces = obj(folder / told["cloth"])
        self.body, self.body_faces = obj(folder / told["body"])
        motion = np.array(told["motion"])
        self.ways, self.turns = motion[:, :3], motion[:, 3:]

    def at(self, time_in_frames):
        """Way and turn (x, y, z, w) between two frames."""
        k = min(int(time_in_frames), self.frames - 1)
        share = time_in_frames - k
        turn = (1 - share) * self.turns[k] + share * self.turns[k + 1]
        way = (1 - share) * self.ways[k] + share * self.ways[k + 1]
        return way, turn / np.linalg.norm(turn)

    def moved(self, points, frame):
        """Points of the rest pose where the body takes them."""
        return points @ matrix(self.turns[frame]).T + self.ways[frame]

    def areas(self):
        a, b, c = (self.cloth[self.faces[:, k]] for k in range(3))
        return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)

    def flat(self):
        """Corners of every face in its own plane, y upwards as far as can be: (F, 3, 2)."""
        x = self.cloth[self.faces]
        normal = np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        up = np.array([0.0, 1.0, 0.0]) - normal * normal[:, 1:2]
        up /= np.linalg.norm(up, axis=1, keepdims=True)
        across = np.cross(up, normal)
        reach = x - x[:, :1]
        return np.stack([(reach * across[:, None]).sum(-1), (reach * up[:, None]).sum(-1)], axis=-1)


class Clock:
    """Wall and processor time of every frame."""

    def __init__(self):
        self.wall, self.cpu = [], []

    def __enter__(self):
        self.since = time.perf_counter(), time.process_time()

    def __exit__(self, *_):
        self.wall.append(time.perf_counter() - self.since[0])
        self.cpu.append(time.process_time() - self.since[1])


def obj(path):
    """Vertices and triangles."""
    verts, faces = [], []
    for line in path.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "v":
            verts.append([float(x) for x in rest])
        elif word == "f":
            faces.append([int(corner.split("/")[0]) - 1 for corner in rest])
    return np.array(verts), np.array(faces, dtype=np.int32)


def matrix(turn):
    """The rotation matrix of a unit quaternion x, y, z, w."""
    x, y, z, w = turn
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


def write(path, scene, cloth, clock, versions):
    """All frames, the start included, in the layout that `muslin evaluate` reads; one line of JSON."""
    np.savez(
        path,
        cloth=np.array(cloth, dtype=np.float32),
        faces=scene.faces,
        body=np.array([scene.moved(scene.body, k) for k in range(scene.frames + 1)], dtype=np.float32),
        body_faces=scene.body_faces,
        rest=scene.cloth.astype(np.float32),
        fps=np.float64(scene.fps),
        seconds_wall=np.array(clock.wall),
        seconds_cpu=np.array(clock.cpu),
        versions=np.array([f"{name} {version}" for name, version in versions.items()]),
    )
    told = {
        "seconds_per_frame": float(np.median(clock.wall)),
        "cpu_seconds_per_frame": float(np.median(clock.cpu)),
        **versions,
    }
    print(json.dumps(told))
