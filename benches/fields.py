#!/usr/bin/env python3
"""Cost of factors, channels, volumes on grids of their own and clip planes: CPU time of a march beside that of the scene without.

    benches/fields.py [SIZE]

Uses the module `relume` and the built-in scene, on the first device that it finds. Prints medians of nine runs in turn; the time of a
device counts where that device is the CPU, as Mesa's is.
"""

import pathlib
import statistics
import sys
import time
import tomllib

import relume

ABSORPTION = {
    "materials.skin.absorption": {"gaussian": [{"centre": 470, "sigma": 40, "height": 1.0}], "base": 0.05},
    "transfer.intervals.skin.absorption": 0.02,
}
FACTOR = [[5, 0], [20, 1]]
SHAPE = {"by": "gradient", "polygon": [[60, 0], [40, 40], [160, 40], [140, 0]]}
AROUND = {"clip.planes": ["x:100%", "-x:100%", "y:100%", "-y:100%", "z:100%", "-z:100%"]}
RUNS = 9


def channel(material):
    """A further field: the frog again, in one material."""
    return {"phantom": "frog", "transfer": {"intervals": [{"material": material, "range": [78, 255], "opacity": 0.02}]}}


ONE = {"shading": "none", "transfer.intervals": [{"material": "skeleton", "range": [78, 255], "opacity": 0.02}]}
THREE = {**ONE, "volumes.one": channel("skin"), "volumes.two": channel("muscle")}

# On a grid of its own.
PLACED = {
    "materials.glow": {"reflectance": "red", "ambient": 1, "diffuse": 0},
    "volumes.other": {**channel("glow"), "transform": [0.99, 0, 0, 1, 0, 0.99, 0, 1, 0, 0, 0.99, 1]},
}

# What the scene shows, again on a grid of its own and shaded by its own normals: everywhere, and moved by half of the width.
FROG = pathlib.Path(__file__).parent.parent / "data/scenes/default.toml"
TRANSFER = tomllib.loads(FROG.read_text())["transfer"]


def again(shift):
    """The frog again, this far along x."""
    return {"volumes.other": {"phantom": "frog", "transfer": TRANSFER, "transform": [0.99, 0, 0, shift, 0, 0.99, 0, 1, 0, 0, 0.99, 1]}}



# Name, scene without, scene with, bar.
ROWS = [
    ("a factor on all terms", {}, {"transfer.gradient_opacity": FACTOR}, 1.3),
    ("a factor on all terms, coloured", ABSORPTION, {**ABSORPTION, "transfer.gradient_opacity": FACTOR}, 2.3),
    ("two groups", {}, {"transfer.intervals.skin.gradient": FACTOR}, 1.3),
    ("two groups, coloured", ABSORPTION, {**ABSORPTION, "transfer.intervals.skin.gradient": FACTOR}, 2.3),
    ("a polygon over values and gradients on a term", {}, {"transfer.intervals.skin.shape": SHAPE}, 1.3),
    ("the same, coloured", ABSORPTION, {**ABSORPTION, "transfer.intervals.skin.shape": SHAPE}, 2.3),
    ("three channels beside one", ONE, THREE, 1.6),
    ("three channels, one of them scaled by another", THREE, {**THREE, "volumes.one.transfer.by": {"two": [[80, 0], [120, 1]]}}, 1.3),
    ("three channels, of which the first hides the others", THREE, {**THREE, "overlap": "first"}, 1.3),
    ("a flat field on its own grid over a shaded one", {}, PLACED, 1.9),
    ("a shaded field on its own grid over a shaded one", {}, again(1), 1.9),
    ("the same, coloured", ABSORPTION, {**ABSORPTION, **again(1)}, 3.5),
    ("the same, half of them overlapping", {}, again(85), 1.8),
    ("a maximum intensity projection", {}, {"blending": "maximum"}, 1.0),
    ("a field on its own grid, not shaded", {"shading": "none"}, {"shading": "none", **PLACED}, 1.9),
    ("the same, coloured", {"shading": "none", **ABSORPTION}, {"shading": "none", **ABSORPTION, **PLACED}, 3.5),
    ("six planes that cut nothing", {}, AROUND, 1.15),
    ("six planes that cut nothing, not shaded", {"shading": "none"}, {"shading": "none", **AROUND}, 1.15),
    ("six planes that cut nothing, coloured", ABSORPTION, {**ABSORPTION, **AROUND}, 2.2),
    ("a plane that cuts half", {}, {"clip.planes": ["y:50%"]}, 1.0),
    ("a corner that three planes cut out", {}, {"clip.planes": ["x:50%", "y:50%", "z:50%"], "clip.keep": "any"}, 1.3),
    ("a plane of one channel of three", THREE, {**THREE, "clip.planes": [{"plane": "y:50%", "volumes": ["one"]}]}, 1.3),
]


def seconds(scene, size):
    """CPU time of a picture, of a volume that the device holds."""
    scene.render((8, 8))
    before = time.process_time()
    scene.render(size)
    return time.process_time() - before


def main():
    """Prints the table."""
    side = int(sys.argv[1]) if len(sys.argv) > 1 else 500
    size = (side, side)
    print(f"| at {side} × {side} | wanted | found | without, ms |")
    print("| --- | --- | --- | --- |")
    for name, without, with_it, bar in ROWS:
        scenes = [relume.Scene.load(FROG, define=changes) for changes in (without, with_it)]
        for scene in scenes:
            seconds(scene, size)
        times = [[seconds(scene, size) for scene in scenes] for _ in range(RUNS)]
        one, other = (statistics.median(column) for column in zip(*times))
        print(f"| {name} | ≤ {bar} | {other / one:.2f} | {1000 * one:.0f} |", flush=True)


if __name__ == "__main__":
    main()
