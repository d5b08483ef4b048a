"""Compiles CUDA kernels with NVRTC and assembles them with ptxas: no warning, no spill.

usage: nvrtc.py KERNELS.cu FOLDER
"""

import ctypes
import pathlib
import re
import subprocess
import sys

import nvidia.cuda_nvcc
import nvidia.cuda_nvrtc

SOURCE, FOLDER = sys.argv[1:]
NVRTC = ctypes.CDLL(str(next((pathlib.Path(nvidia.cuda_nvrtc.__path__[0]) / "lib").glob("libnvrtc.so.*"))))
PTXAS = pathlib.Path(nvidia.cuda_nvcc.__path__[0]) / "bin" / "ptxas"


def told(program, size, text):
    """What NVRTC says of a program."""
    n = ctypes.c_size_t()
    assert size(program, ctypes.byref(n)) == 0
    room = ctypes.create_string_buffer(n.value)
    assert text(program, room) == 0
    return room.value


def ptx(architecture, frames):
    program = ctypes.c_void_p()
    source = open(SOURCE, "rb").read()
    assert NVRTC.nvrtcCreateProgram(ctypes.byref(program), source, SOURCE.encode(), 0, None, None) == 0
    words = [f"--gpu-architecture=compute_{architecture}", f"-DFRAMES={frames}", "-DBLOCK=128"]
    options = (ctypes.c_char_p * len(words))(*(w.encode() for w in words))
    failed = NVRTC.nvrtcCompileProgram(program, len(words), options)
    log = told(program, NVRTC.nvrtcGetProgramLogSize, NVRTC.nvrtcGetProgramLog).decode().strip()
    if failed or log:
        sys.exit(f"compute_{architecture}, {frames} frames: {log}")
    return told(program, NVRTC.nvrtcGetPTXSize, NVRTC.nvrtcGetPTX)


for architecture in (75, 80, 86, 90):
    for frames in (16, 1):
        path = pathlib.Path(FOLDER) / "kernels.ptx"
        path.write_bytes(ptx(architecture, frames))
        words = [PTXAS, "-v", f"-arch=sm_{architecture}", path, "-o", path.with_suffix(".cubin")]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
        names = re.findall(r"entry function '(\w+)'", done.stderr)
        registers = re.findall(r"Used (\d+) registers", done.stderr)
        spilled = [int(n) for n in re.findall(r"(\d+) bytes spill", done.stderr)]
        each = ", ".join(f"{name} {n}" for name, n in zip(names, registers))
        print(f"sm_{architecture}, {frames} frames a block: registers {each}")
        if len(names) < 4 or any(spilled):
            sys.exit(f"spills: {done.stderr}")
