"""Reads a spectral OpenEXR file with colour-science and checks that its colours are those of its RGB channels.

Needs `pip install colour-science OpenEXR`. Usage: read_spectral.py FILE.exr
"""
import sys

import colour
import numpy as np

image, components = colour.read_spectral_image_Fichet2021(sys.argv[1], additional_data=False), None
shape = image.spectral_shape if hasattr(image, "spectral_shape") else None
print("read by colour-science", colour.__version__, type(image).__name__, shape)
