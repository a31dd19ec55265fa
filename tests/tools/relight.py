"""Relights an accumulator file of a colour model under its own lights, by the documentation of output::accumulators
alone, and checks that the picture that Relume made of it shows the same.

Needs Python 3.11 and `pip install numpy OpenImageIO`. Usage: relight.py ACCUMULATORS.exr PICTURE.exr
"""

import sys
import tomllib

import numpy as np
import OpenImageIO


def parts(path):
    """Every part of the file by its name, as a plane for each channel; and the attribute `relume`."""
    file, found, text = OpenImageIO.ImageInput.open(path), {}, ""
    while file.seek_subimage(len(found), 0):
        spec = file.spec()
        pixels = file.read_image(len(found), 0, 0, spec.nchannels, "float")
        name = spec.get_string_attribute("oiio:subimagename") or "only"
        found[name] = {channel: pixels[..., i].astype(float) for i, channel in enumerate(spec.channelnames)}
        text = spec.get_string_attribute("relume") or text
    return found, text


accumulators, text = parts(sys.argv[1])
text = tomllib.loads(text)
numbers, model = accumulators["accumulators"], text["model"]
projection = np.array(model["projection"])
k = len(projection)
assert text["version"] == 3 and projection.shape == (k, 81), projection.shape
assert accumulators["cloud"]["spectrum"].shape[1] == 81
assert text.get("adapt", False) is False

everywhere, xyz = np.zeros((k, 3)), 0.0
for position in text["positions"]:
    lights = [light for light in text["lights"] if light["position"] == position["name"]]
    matrix = sum(light["weight"] * np.array(light["matrix"]) for light in lights)
    everywhere += matrix
    kept = np.stack([numbers[f"{position['name']}.{i}"] for i in range(k)], axis=-1)
    xyz = xyz + kept @ matrix
assert model["transmittance"] == "coloured"
passed = np.stack([numbers[f"transmittance_{i}"] for i in range(k)], axis=-1)
xyz = xyz + (passed * (projection @ np.array(text["background"]))) @ everywhere

# Linear sRGB of XYZ to seven digits (Lindbloom; the primaries of IEC 61966-2-1, and D65 as 0.95047, 1, 1.08883).
rgb_from_xyz = np.array(
    [[3.2404542, -1.5371385, -0.4985314], [-0.9692660, 1.8760108, 0.0415560], [0.0556434, -0.2040259, 1.0572252]]
)
expected = text["exposure"] * xyz @ rgb_from_xyz.T

(picture,) = parts(sys.argv[2])[0].values()
found = np.stack([picture[channel] for channel in "RGB"], axis=-1)
difference = np.abs(found - expected).max()
assert found.max() > 0.01, "a black picture shows nothing"
assert difference <= 1e-5, difference
print(f"relit {found.shape[1]}x{found.shape[0]} pixels of {k} numbers by the documentation; "
      f"the picture differs by at most {difference:.1e}")
