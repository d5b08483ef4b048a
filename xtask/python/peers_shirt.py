"""Newton's example shirt (USD) as OBJ, in metres, Y up: `peers_shirt.py OUT.obj`.

Blender reads and writes it, Newton only says where it is.
"""

import importlib.util
import pathlib
import sys

import bpy


def main() -> None:
    newton = importlib.util.find_spec("newton")
    shirt = pathlib.Path(newton.origin).parent / "examples" / "assets" / "unisex_shirt.usd"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.wm.usd_import(filepath=str(shirt))
    bpy.ops.wm.obj_export(
        filepath=sys.argv[1],
        export_materials=False,
        export_normals=False,
        forward_axis="NEGATIVE_Z",
        up_axis="Y",
    )


if __name__ == "__main__":
    main()
