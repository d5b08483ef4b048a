"""Compiles CUDA kernels with NVRTC and assembles them with ptxas: no warning, no spill.

usage: nvrtc.py KERNELS.cu FOLDER OPTIONS...

Each of OPTIONS is one set of macros, as in "-DFRAMES=16 -DBLOCK=128".
"""

import ctypes
import pathlib
import re
import subprocess
import sys

import nvidia.cuda_nvcc
import nvidia.cuda_nvrtc

SOURCE, FOLDER, *OPTIONS = sys.argv[1:]
KERNELS = len(re.findall(r"^__global__", open(SOURCE).read(), re.MULTILINE))
NVRTC = ctypes.CDLL(str(next((pathlib.Path(nvidia.cuda_nvrtc.__path__[0]) / "lib").glob("libnvrtc.so.*"))))
PTXAS = pathlib.Path(nvidia.cuda_nvcc.__path__[0]) / "bin" / "ptxas"


def told(program, size, text):
    """What NVRTC says of a program."""
    n = ctypes.c_size_t()
    assert size(program, ctypes.byref(n)) == 0
    room = ctypes.create_string_buffer(n.value)
    assert text(program, room) == 0
    return room.value


def ptx(architecture, told_of):
    program = ctypes.c_void_p()
    source = open(SOURCE, "rb").read()
    assert NVRTC.nvrtcCreateProgram(ctypes.byref(program), source, SOURCE.encode(), 0, None, None) == 0
    words = [f"--gpu-architecture=compute_{architecture}", *told_of.split()]
    options = (ctypes.c_char_p * len(words))(*(w.encode() for w in words))
    failed = NVRTC.nvrtcCompileProgram(program, len(words), options)
    log = told(program, NVRTC.nvrtcGetProgramLogSize, NVRTC.nvrtcGetProgramLog).decode().strip()
    if failed or log:
        sys.exit(f"compute_{architecture}, {told_of}: {log}")
    return told(program, NVRTC.nvrtcGetPTXSize, NVRTC.nvrtcGetPTX)


for architecture in (75, 80, 86, 90):
    for told_of in OPTIONS:
        path = pathlib.Path(FOLDER) / "kernels.ptx"
        path.write_bytes(ptx(architecture, told_of))
        words = [PTXAS, "-v", f"-arch=sm_{architecture}", path, "-o", path.with_suffix(".cubin")]
        done = subprocess.run(words, capture_output=True, text=True)
        if done.returncode:
            sys.exit(done.stderr)
        names = re.findall(r"entry function '(\w+)'", done.stderr)
        registers = re.findall(r"Used (\d+) registers", done.stderr)
        spilled = [int(n) for n in re.findall(r"(\d+) bytes spill", done.stderr)]
        each = ", ".join(f"{name} {n}" for name, n in zip(names, registers))
        print(f"sm_{architecture}, {told_of}: registers {each}")
        if len(names) != KERNELS or any(spilled):
            sys.exit(f"spills: {done.stderr}")
