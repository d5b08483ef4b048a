"""Says of each file whether NumPy finds the exchange layout in it, whole and without pickles."""

import sys

import numpy as np

for path in sys.argv[1:]:
    with np.load(path, allow_pickle=False) as file:
        a = {name: file[name] for name in file.files}
    shapes = ", ".join(f"{n} {v.dtype} {v.shape}" for n, v in a.items())
    for value in a.values():
        assert value.dtype.kind == "U" or np.isfinite(value).all()
    assert a["fps"].shape == () and a["fps"] > 0
    if "cloth" in a:
        frames, n, three = a["cloth"].shape
        assert three == 3 and a["cloth"].dtype == np.float32 and a["faces"].dtype == np.int32
        assert a["faces"].shape[1] == 3 and 0 <= a["faces"].min() and a["faces"].max() < n
        if "body" in a:
            assert a["body"].shape[0] == frames and a["body"].dtype == np.float32
            assert a["body_faces"].max() < a["body"].shape[1]
        if "rest" in a:
            assert a["rest"].shape == (n, 3)
        if "rest_corners" in a:
            assert a["rest_corners"].shape == (len(a["faces"]), 3, 2)
    else:
        frames, bones, four = a["rotations"].shape
        assert four == 4 and a["root"].shape == (frames, 3) and len(a["bones"]) == bones
        assert np.allclose(np.linalg.norm(a["rotations"], axis=-1), 1, atol=1e-5)
    print(f"sound {path}: {shapes}")
