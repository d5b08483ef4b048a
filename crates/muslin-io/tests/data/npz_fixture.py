"""Writes numpy.npz beside itself: arrays of every kind that the reader takes."""

import pathlib

import numpy as np

ramp = np.arange(24, dtype="f8").reshape(2, 3, 4) / 2
np.savez_compressed(
    pathlib.Path(__file__).with_name("numpy.npz"),
    f4=ramp.astype("<f4"),
    f8=ramp,
    f2=ramp.astype("<f2"),
    big=ramp.astype(">f4"),
    fortran=np.asfortranarray(ramp.astype("<f4")),
    faces=np.array([[0, 1, 2], [1, 3, 2]], dtype="<u2"),
    fps=np.float64(30),
    bones=np.array(["root", "spine05", "µ"]),
    truth=np.array([True, False]),
    empty=np.zeros((0, 3), "<f4"),
)
