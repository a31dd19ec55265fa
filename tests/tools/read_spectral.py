"""Reads a spectral OpenEXR file with colour-science, and checks that its spectra have the colours of its RGB channels.

Needs `pip install colour-science OpenImageIO`. Usage: read_spectral.py FILE.exr
"""

import sys

import colour
import numpy as np
import OpenImageIO

path = sys.argv[1]
components, found = colour.read_spectral_image_Fichet2021(path, additional_data=True)
wavelengths_nm, radiance = components["S0"]
assert found.is_emissive and not found.is_polarised, found
assert np.array_equal(wavelengths_nm, np.arange(380, 785, 5)), wavelengths_nm

observer = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
observer = observer.copy().align(colour.SpectralShape(380, 780, 5)).values
# A light is scaled so that white under it has the sum 1 over the samples of the luminance.
xyz = radiance @ observer
rgb_from_xyz = colour.RGB_COLOURSPACES["sRGB"].matrix_XYZ_to_RGB
expected = xyz @ rgb_from_xyz.T

file = OpenImageIO.ImageInput.open(path)
order = list(file.spec().channelnames)
pixels = file.read_image("float")
preview = np.stack([pixels[..., order.index(name)] for name in "RGB"], axis=-1)
# Observers with 5 and 6 digits, and matrices with 4 and 7, agree to this share of white.
difference = np.abs(expected - preview).max()
assert preview.max() > 0.01, "a black picture shows nothing"
assert difference <= 1e-3, difference
print(f"colour-science {colour.__version__} read {radiance.shape[1]}x{radiance.shape[0]} spectra of {len(wavelengths_nm)} bands; "
      f"their colours differ from the preview by at most {difference:.1e}")
