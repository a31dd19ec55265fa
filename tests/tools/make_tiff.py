"""Writes the files of tests/data/tiff with tifffile, and the slices of tests/data/hostile/slices with Pillow:
python3 make_tiff.py tests/data/tiff tests/data/hostile/slices (needs tifffile, imagecodecs, Pillow and numpy).

Every voxel has the number n = x² + 7y + 40z + 300c, c its component; `number` maps it into the type. Pages have 21 × 17
voxels, there are 3 slices. tests/readers/tiff.rs has the same formula."""

import sys
from pathlib import Path

import numpy
import tifffile
from PIL import Image

FOLDER, SLICES = map(Path, sys.argv[1:])
WIDTH, HEIGHT, DEPTH = 21, 17, 3
ORDERS = {"little": "<", "big": ">"}


def numbers(components=1, width=WIDTH, height=HEIGHT, depth=DEPTH):
    """n in the order c, z, y, x."""
    c, z, y, x = numpy.meshgrid(*map(numpy.arange, (components, depth, height, width)), indexing="ij")
    return x * x + 7 * y + 40 * z + 300 * c


def number(n, dtype):
    match dtype:
        case "uint8":
            n = n % 251
        case "int8":
            n = n % 251 - 125
        case "uint16":
            n = n * 37 % 65521
        case "int16":
            n = n * 37 % 65521 - 30000
        case "uint32":
            n = n * 1000003 % 4294967291
        case "int32":
            n = n * 1000003 % 4294967291 - 2000000000
        case "uint64":
            n = n * 10**15
        case "int64":
            n = n * 10**15 - 10**17
        case "float16":
            n = n / 8
        case "float32":
            n = n / 8 - 20
        case "float64":
            n = n / 1024 + 1e6
    return n.astype(dtype)


def write(name, array, order="little", **options):
    options = {"photometric": "minisblack", "metadata": None, "software": False} | options
    tifffile.imwrite(FOLDER / f"{name}.tif", array, byteorder=ORDERS[order], **options)


def grey(dtype):
    return number(numbers()[0], dtype)


def colours(dtype, components=3):
    """Interleaved: z, y, x, c."""
    return number(numpy.moveaxis(numbers(components), 0, -1), dtype)


TYPES = "uint8 int8 uint16 int16 uint32 int32 uint64 int64 float16 float32 float64".split()
for dtype in TYPES:
    for order in ORDERS:
        write(f"none_{dtype}_{order}", grey(dtype), order, rowsperstrip=5)
TILE = (16, 16)
for dtype in ("uint8", "uint16", "float32"):
    write(f"lzw_{dtype}_strips", grey(dtype), "big", compression="lzw", rowsperstrip=6)
    write(f"lzw_{dtype}_tiles", grey(dtype), compression="lzw", predictor=True, tile=TILE)
for dtype in ("uint8", "int16", "uint32"):
    write(f"deflate_{dtype}_predictor", grey(dtype), "big", compression="zlib", predictor=True, rowsperstrip=4)
for dtype in ("float16", "float32", "float64"):
    write(f"deflate_{dtype}_predictor", grey(dtype), "big", compression="zlib", predictor=True, rowsperstrip=4)
    write(f"zstd_{dtype}_tiles", grey(dtype), compression="zstd", predictor=True, tile=TILE)
write("zstd_uint16_strips", grey("uint16"), compression="zstd", predictor=True, rowsperstrip=17)
write("packbits_uint8_strips", grey("uint8"), compression="packbits", rowsperstrip=5)
write("packbits_int16_tiles", grey("int16"), "big", compression="packbits", tile=TILE)
write("none_uint16_tiles", grey("uint16"), tile=(32, 16))
write("bigtiff_uint16", grey("uint16"), "big", compression="zlib", bigtiff=True)
# Colours.
write("rgb_uint8", colours("uint8"), compression="lzw", predictor=True, photometric="rgb", rowsperstrip=3)
write("rgb_uint16_tiles", colours("uint16"), "big", compression="zlib", predictor=True, photometric="rgb", tile=TILE)
write("rgb_float32_predictor", colours("float32"), compression="zlib", predictor=True, photometric="rgb")
write("rgba_uint8", colours("uint8", 4), photometric="rgb", extrasamples=["unassalpha"])
planar = number(numpy.moveaxis(numbers(3), 0, 1), "uint16")
write("planar_uint16", planar, "big", photometric="rgb", planarconfig="separate", rowsperstrip=5)
write("planar_uint16_tiles", planar, compression="lzw", photometric="rgb", planarconfig="separate", tile=TILE)
# Bits, inverted values, colour maps.
write("bits", (numbers()[0] % 3 == 0), photometric="minisblack", rowsperstrip=5)
write("inverted_uint8", grey("uint8"), photometric="miniswhite")
colormap = numpy.arange(3 * 256, dtype="uint16").reshape(3, 256)
write("palette_uint8", grey("uint8"), photometric="palette", colormap=colormap)
# JPEG, whose greys differ by at most 2. Smooth, so that little is lost.
smooth = (numbers()[0] // 4).astype("uint8")
write("jpeg_uint8", smooth, compression="jpeg", compressionargs={"level": 100}, rowsperstrip=8)
write("jpeg_uint8_tiles", smooth, compression="jpeg", compressionargs={"level": 100}, tile=TILE)
rgb = numpy.stack([smooth, 255 - smooth, smooth // 2], axis=-1)
write("jpeg_rgb", rgb, compression="jpeg", compressionargs={"level": 100}, photometric="ycbcr", subsampling=(1, 1))
# tifffile would store luminance and differences; libtiff stores red, green and blue.
first, *others = map(Image.fromarray, rgb)
first.save(FOLDER / "jpeg_plain_rgb.tif", save_all=True, append_images=others, compression="jpeg", quality=100)
four = numpy.concatenate([rgb, 100 + smooth[..., None] // 2], axis=-1)
write("jpeg_plain_cmyk", four, compression="jpeg", compressionargs={"level": 100}, photometric="separated", rowsperstrip=17)
# A small copy of the page before it.
with tifffile.TiffWriter(FOLDER / "thumbnails.tif") as file:
    for page in grey("uint8"):
        options = {"photometric": "minisblack", "metadata": None, "software": False, "contiguous": False}
        file.write(page, **options)
        file.write(page[::4, ::4], subfiletype=1, **options)

# ImageJ: times, slices, channels.
stack = number(numbers(2)[None] + numpy.array([0, 11])[:, None, None, None, None], "uint16")
stack = numpy.moveaxis(stack, 1, 2)
imagej = {
    "axes": "TZCYX",
    "spacing": 2.5,
    "unit": "\\u00B5m",
    "Ranges": (10.0, 200.0, 30.0, 4000.0),
    "mode": "composite",
    "Info": "made by a formula",
}
for order in ORDERS:
    tifffile.imwrite(FOLDER / f"imagej_{order}.tif", stack, byteorder=ORDERS[order], imagej=True, resolution=(4, 2),
                     metadata=imagej, software=False)
tifffile.imwrite(FOLDER / "imagej_one_directory.tif", stack, imagej=True, metadata={"axes": "TZCYX", "min": 3.0, "max": 70.0},
                 software=False, truncate=True)

# OME.
ome = {
    "axes": "CZYX",
    "Name": "cells",
    "PhysicalSizeX": 500, "PhysicalSizeXUnit": "nm",
    "PhysicalSizeY": 0.5, "PhysicalSizeYUnit": "µm",
    "PhysicalSizeZ": 0.002, "PhysicalSizeZUnit": "mm",
    "Channel": {"Name": ["DAPI", "GFP"]},
}
both = number(numbers(2), "uint16")
tifffile.imwrite(FOLDER / "channels.ome.tif", both, ome=True, metadata=ome, compression="zlib", software=False)
with tifffile.TiffWriter(FOLDER / "series.ome.tif", ome=True) as file:
    file.write(grey("uint8"), photometric="minisblack", metadata={"axes": "ZYX", "Name": "left"}, software=False)
    file.write(number(numbers(1, 12, 10, 2)[0], "uint16"), photometric="minisblack",
               metadata={"axes": "ZYX", "Name": "right"}, software=False)
with tifffile.TiffWriter(FOLDER / "pyramid.ome.tif", ome=True, bigtiff=True) as file:
    fine = number(numbers(2, 32, 24), "uint8")
    options = {"photometric": "minisblack", "tile": TILE, "compression": "lzw", "software": False}
    file.write(fine, subifds=2, metadata={"axes": "CZYX", "PhysicalSizeX": 0.5, "PhysicalSizeY": 0.5}, **options)
    file.write(fine[..., ::2, ::2], subfiletype=1, metadata=None, **options)
    file.write(fine[..., ::4, ::4], subfiletype=1, metadata=None, **options)
tifffile.imwrite(FOLDER / "rgb.ome.tif", colours("uint8"), ome=True, photometric="rgb", metadata={"axes": "ZYXS"},
                 software=False)

# OME in two files: a channel in each.
xml = (
    '<?xml version="1.0" encoding="UTF-8"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
    'UUID="urn:uuid:{own}"><Image ID="Image:0"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint16" SizeX="21" '
    'SizeY="17" SizeZ="3" SizeC="2" SizeT="1"><Channel ID="Channel:0:0" Name="one" SamplesPerPixel="1"/>'
    '<Channel ID="Channel:0:1" Name="two" SamplesPerPixel="1"/>'
    '<TiffData IFD="0" PlaneCount="3"><UUID FileName="two_files_1.ome.tif">urn:uuid:1</UUID></TiffData>'
    '<TiffData IFD="0" FirstC="1" PlaneCount="3"><UUID FileName="two_files_2.ome.tif">urn:uuid:2</UUID></TiffData>'
    "</Pixels></Image></OME>"
)
for own in (1, 2):
    with tifffile.TiffWriter(FOLDER / f"two_files_{own}.ome.tif") as file:
        for z, page in enumerate(both[own - 1]):
            file.write(page, photometric="minisblack", metadata=None, software=False, contiguous=False,
                       description=xml.format(own=own) if z == 0 else None)

# Slices to damage.
small = grey("uint8")[0]
Image.fromarray(small).save(SLICES / "grey.png")
Image.fromarray(grey("uint16")[0]).save(SLICES / "wide.png")
Image.fromarray(small).quantize(16).save(SLICES / "palette.png", bits=4)
Image.fromarray(small > 100).save(SLICES / "bits.png")
Image.fromarray(colours("uint8")[0]).save(SLICES / "rgb.png")
Image.fromarray(smooth[0]).save(SLICES / "grey.jpg", quality=60)
Image.fromarray(rgb[0]).save(SLICES / "rgb.jpg", quality=60, progressive=True)
Image.fromarray(small).save(SLICES / "grey.bmp")
Image.fromarray(rgb[0]).save(SLICES / "rgb.bmp")
Image.fromarray(small).save(SLICES / "grey.pgm")
Image.fromarray(rgb[0]).save(SLICES / "rgb.ppm")
Image.fromarray(small > 100).save(SLICES / "bits.pbm")
(SLICES / "text.pgm").write_text("P2\n# slice\n4 3\n99\n" + " ".join(map(str, range(12))) + "\n")
