"""The reference for people and joints: MediaPipe 0.10.14 and LiteRT, one answer a line.

Reads commands on standard input and answers each with one line of JSON:

  photo PATH            points [px, px, visibility] and metres of the best person, or null
  tensor MODEL INPUT    all outputs of a network for a made-up input
  time MODEL            CPU milliseconds of one run on one thread

MODEL is "detector" or "landmarks"; INPUT is "noise" or "waves".
"""

import json
import os
import sys
import time

import mediapipe as mp
import numpy as np
from ai_edge_litert.interpreter import Interpreter
from PIL import Image, ImageOps

MODULES = os.path.join(os.path.dirname(mp.__file__), "modules")
FILES = {
    "detector": ("pose_detection/pose_detection.tflite", -1.0),
    "landmarks": ("pose_landmark/pose_landmark_full.tflite", 0.0),
}


def interpreter(model):
    path = os.path.join(MODULES, FILES[model][0])
    net = Interpreter(path, num_threads=1)
    net.allocate_tensors()
    return net


def made_up(model, kind, shape):
    """Values that any language makes exactly: hashed counters, or triangle waves."""
    low = FILES[model][1]
    if kind == "noise":
        hashed = (np.arange(np.prod(shape), dtype=np.uint64) * 2654435761) & 0xFFFFFFFF
        unit = (hashed >> 8).astype(np.float32) / np.float32(1 << 24)
        unit = unit.reshape(shape)
    else:
        _, h, w, c = shape
        y, x, k = np.meshgrid(np.arange(h), np.arange(w), np.arange(c), indexing="ij")
        phase = ((3 * x + 5 * y + 40 * k) % 64).astype(np.float32) / np.float32(32)
        unit = np.abs(phase - np.float32(1)).reshape(shape)
    return unit * np.float32(1 - low) + np.float32(low)


def tensor(nets, model, kind):
    net = nets[model]
    entry = net.get_input_details()[0]
    net.set_tensor(entry["index"], made_up(model, kind, entry["shape"]))
    net.invoke()
    outputs = [net.get_tensor(o["index"]).ravel() for o in net.get_output_details()]
    return [[float(x) for x in o] for o in outputs]


def timed(net):
    start = time.process_time()
    net.invoke()
    return (time.process_time() - start) * 1e3


def photo(pose, path):
    picture = ImageOps.exif_transpose(Image.open(path)).convert("RGB")
    found = pose.process(np.asarray(picture))
    if found.pose_landmarks is None:
        return None
    w, h = picture.size
    points = [[p.x * w, p.y * h, p.visibility] for p in found.pose_landmarks.landmark]
    world = [[p.x, p.y, p.z] for p in found.pose_world_landmarks.landmark]
    return {"points": points, "world": world}


def main():
    pose = mp.solutions.pose.Pose(static_image_mode=True, model_complexity=1)
    nets = {model: interpreter(model) for model in FILES}
    for line in sys.stdin:
        what, *rest = line.rstrip("\n").split(" ", 1)
        words = rest[0].split(" ") if rest else []
        if what == "photo":
            answer = photo(pose, rest[0])
        elif what == "tensor":
            answer = tensor(nets, *words)
        else:
            answer = timed(nets[words[0]])
        print(json.dumps(answer), flush=True)


main()
