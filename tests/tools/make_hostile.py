"""Writes tests/data/hostile: small sound files of each kind, which tests and fuzz targets damage.

Accumulators are made by the ignored test of tests/hostile.rs.
VTK's files are in tests/data/vti.
"""

import bz2
import gzip
import pathlib
import struct
import zlib

ROOT = pathlib.Path(__file__).resolve().parent.parent / "data" / "hostile"
BYTES = bytes(range(24))
SHORTS = struct.pack("<24h", *range(-12, 12))


def write(name, *parts):
    path = ROOT / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"".join(part.encode() if isinstance(part, str) else part for part in parts))


def metaimage():
    head = "ObjectType = Image\nNDims = 3\nDimSize = 4 3 2\nElementSpacing = 1 1.5 2\nOffset = -1 0 1e3\n"
    turned = "TransformMatrix = 0 1 0 1 0 0 0 0 -1\nComment = a word\n"
    local = "ElementDataFile = LOCAL\n"
    write("metaimage/bytes", head, turned, "ElementType = MET_UCHAR\n", local, BYTES)
    write("metaimage/big", head, "ElementByteOrderMSB = True\nElementType = MET_SHORT\n", local, SHORTS)
    packed = zlib.compress(SHORTS)
    write(
        "metaimage/zlib",
        head,
        f"CompressedData = True\nCompressedDataSize = {len(packed)}\nElementType = MET_SHORT\n",
        local,
        packed,
    )
    write("metaimage/text", head, "BinaryData = False\nElementType = MET_FLOAT\n", local, " ".join(map(str, range(24))))
    scaled = "ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = -1024\nHeaderSize = -1\n"
    write("metaimage/beside", head, scaled, "ElementType = MET_UCHAR\nElementDataFile = v.raw\n")
    write("metaimage/list", head, "ElementType = MET_UCHAR\nElementDataFile = LIST 2D\nv1\nv2\n")
    write("metaimage/pattern", head, "ElementType = MET_UCHAR\nElementDataFile = v%d 1 2 1\n")
    write(
        "metaimage/vectors",
        "NDims = 4\nDimSize = 2 2 1 2\nElementNumberOfChannels = 3\nElementType = MET_UCHAR\n",
        local,
        BYTES,
    )


def nrrd():
    magic = "NRRD0005\n# a comment\ntype: {}\ndimension: 3\nsizes: 4 3 2\nendian: little\nencoding: {}\n"
    place = "space: right-anterior-superior\nspace directions: (1,0,0) (0,0,2) (0,1.5,0)\nspace origin: (1,-2,1e3)\n"
    write("nrrd/raw", magic.format("short", "raw"), place, "key:=value\n\n", SHORTS)
    write("nrrd/gzip", magic.format("short", "gzip"), place, "\n", gzip.compress(SHORTS, mtime=0))
    write("nrrd/bzip2", magic.format("short", "bzip2"), "\n", bz2.compress(SHORTS))
    write("nrrd/hex", magic.format("uchar", "hex"), "\n", BYTES.hex())
    write("nrrd/text", magic.format("float", "ascii"), "\n", " ".join(map(str, range(24))))
    mins = "spacings: 1 2 nan\naxis mins: 0 1 nan\ncenterings: cell node ???\n"
    write("nrrd/skips", magic.format("uchar", "raw"), mins, "line skip: 1\nbyte skip: 2\n\nskipped\n..", BYTES)
    write("nrrd/tail", magic.format("uchar", "gz"), "byte skip: -1\n\n", gzip.compress(b"before" + BYTES, mtime=0))
    write("nrrd/beside", magic.format("uchar", "raw"), "data file: v.raw\nbyte skip: -1\n")
    write("nrrd/list", magic.format("uchar", "raw"), "data file: LIST 2\nv1\nv2\n")
    write("nrrd/pattern", magic.format("uchar", "raw"), "data file: v%d 1 2 1 2\n")
    vectors = "NRRD0004\ntype: uchar\ndimension: 5\nsizes: 3 2 2 1 2\nencoding: raw\n"
    kinds = "kinds: RGB-color domain domain domain time\n"
    write("nrrd/vectors", vectors, kinds, "space dimension: 3\n", "\n", BYTES)


def sidecar():
    write("sidecar/bytes", "dims = [4, 3, 2]\ntype = 'uint8'\nspacing = [1, 1.5, 2]\norigin = [-1, 0, 1e3]\n")
    write("sidecar/shorts", "[volume]\ndims = [4, 3, 2]\ntype = 'int16'\nbyte_order = 'big'\nheader_bytes = 16\n")
    turned = "direction = [0, 1, 0, 1, 0, 0, 0, 0, -1]\n"
    write("sidecar/slices", "file = 'v%d'\nslices = [1, 2]\ndims = [4, 3, 2]\ntype = 'uint8'\n", turned)


def scene():
    volume = "version = 1\n[volume]\nphantom = 'frog'\ndims = [6, 5, 4]\n"
    write(
        "scene/frog",
        volume,
        "[materials.flesh]\nreflectance = 'foliage'\nspecular = 0.2\nexponent = 20\n"
        "[materials.bone]\nreflectance = 'white 9.5'\nambient = 0.2\nxray = true\n"
        "[transfer]\nopacity_length = 1.0\nintervals = [\n"
        "  { material = 'flesh', range = [30, 90], ramp = 5, opacity = 0.1 },\n"
        "  { material = 'bone', range = [180, 255], opacity = 0.9 },\n]\n"
        "[lights.day]\nspectrum = 'D65'\nkind = 'directional'\ndirection = [-0.4, -0.7, -0.6]\n"
        "[lights.lamp]\nspectrum = 'A'\nkind = 'point'\nposition = [9, 9, 9]\nintensity = 0.5\n",
    )
    write(
        "scene/curves",
        volume,
        "spacing = [1, 1, 2]\norigin = [0, 0, 1]\ndownsample = [2, 1, 1]\n[crop]\nmin = [0, 0, 0]\nmax = [2, 3, 3]\n"
        "[materials.glass]\nreflectance = { gaussian = [{ centre = 550, sigma = 20, height = 0.8 }], base = 0.05 }\n"
        "absorption = { 400 = 0.1, '532.5' = 0.3 }\n"
        "[materials.skin]\nreflectance = { srgb = '#c08060' }\n"
        "[transfer]\nopacity = [[0, 0], [255, 1]]\nabsorption = [[0, 0], [255, 2]]\nmaterial = [[0, 'glass'], [99, 'skin']]\n"
        "[lights.lamp]\nspectrum = { blackbody = 2856 }\nkind = 'ambient'\n"
        "[camera]\nprojection = 'orthographic'\nposition = [9, 9, 9]\ntarget = [1, 1, 1]\nup = [0, 0, 1]\nheight = 9\n"
        "[accuracy]\nstep = 0.5\ntermination = 0\nk = 7\nmodel = 'sharpened'\n[display]\nexposure = 2\nadapt = true\n",
    )
    write(
        "scene/defined",
        volume,
        "[materials.paper]\nreflectance = 1\n[lights.lamp]\nspectrum = 'E'\n"
        "\0lights.lamp.intensity=2\0materials.paper.diffuse=0.5\0camera={fov=20,azimuth=30}",
    )


def mgh():
    def head(kind, frames, flag):
        sides = struct.pack(">7ih", 1, 4, 3, 2 // frames, frames, kind, 0, flag)
        place = struct.pack(">15f", 1, 1.5, 2, -1, 0, 0, 0, 0, -1, 0, 1, 0, 4, -3, 2)
        return (sides + place).ljust(284, b"\0")

    shorts = struct.pack(">24h", *range(-12, 12))
    footer = struct.pack(">5f", 2300, 0.1, 3, 900, 256)
    write("mgh/bytes", head(0, 1, 1), BYTES)
    write("mgh/frames", head(4, 2, 1), shorts, footer)
    write("mgh/unplaced", head(4, 1, 0), shorts)
    write("mgh/gzip", gzip.compress(head(3, 1, 1) + struct.pack(">24f", *range(24)) + footer, mtime=0))


def spectrum():
    write("spectrum/commas", "nm,power\n# a comment\n400,0.1\n500,0.3\n700.5,1e-3\n")
    write("spectrum/blanks", "380 0.5\n385 0.25\n390 0.125\n780 0\n")
    write("spectrum/quotes", '"wavelength";"skin";"bone"\n400;0.1;0.2\n700;0.3;0.4;\n')


for make in (metaimage, nrrd, mgh, sidecar, scene, spectrum):
    make()
