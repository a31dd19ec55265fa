"""Writes the Zarr stores of tests/data/zarr, each as one bundle of its files, with zarr-python 3 and numcodecs.

    python3 tests/tools/make_zarr.py tests/data/zarr

A bundle is a list of files: length of the name (1 byte), name, length of the content (4 bytes, little-endian), content.
The number of voxel (x, y, z) in channel c at time t is n = x*x + 7*y + 40*z + 300*c + 1000*t; its value in a type is
n % 251 (uint8), n (uint16 to uint64, int16 to int64), n / 8 (floats), n % 3 == 0 (bool).
"""

import shutil
import struct
import sys
import tempfile
from pathlib import Path

import numcodecs
import numpy as np
import zarr

from arrays import SHAPE, numbers


def bundle(folder, path):
    with open(path, "wb") as out:
        for file in sorted(p for p in Path(folder).rglob("*") if p.is_file()):
            name, content = file.relative_to(folder).as_posix().encode(), file.read_bytes()
            out.write(struct.pack("<B", len(name)) + name + struct.pack("<I", len(content)) + content)


def write(out, name, make):
    with tempfile.TemporaryDirectory() as folder:
        make(folder)
        bundle(folder, out / f"{name}.bundle")


def v2(dtype, compressor, order="C", chunks=(3, 4, 5), separator=".", fill=0, shape=SHAPE):
    def make(folder):
        array = zarr.create_array(
            folder, shape=shape, chunks=chunks, dtype=dtype, zarr_format=2, compressors=compressor, order=order,
            fill_value=fill, chunk_key_encoding={"name": "v2", "separator": separator},
        )
        array[...] = numbers(dtype, shape)

    return make


def v3(dtype, codecs="auto", chunks=(3, 4, 5), shards=None, filters="auto", serializer="auto", fill=0, separator="/"):
    def make(folder):
        array = zarr.create_array(
            folder, shape=SHAPE, chunks=chunks, shards=shards, dtype=dtype, zarr_format=3, compressors=codecs,
            filters=filters, serializer=serializer, fill_value=fill,
            chunk_key_encoding={"name": "default", "separator": separator},
        )
        array[...] = numbers(dtype)

    return make


def image(folder):
    """An image of two channels and two times in two levels, with a label image."""
    group = zarr.open_group(folder, mode="w", zarr_format=2)
    axes = [{"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"}]
    units = {"z": "nanometer", "y": "micrometer", "x": "micrometer"}
    space = [{"name": name, "type": "space", "unit": unit} for name, unit in units.items()]
    datasets = []
    for level in range(2):
        step = 2**level
        full = numbers("uint16", (2, 2) + SHAPE)
        data = full[:, :, ::step, ::step, ::step]
        array = group.create_array(
            f"level{level}", shape=data.shape, chunks=(1, 1, 4, 5, 6), dtype="uint16", compressors=numcodecs.Blosc("zstd"),
            chunk_key_encoding={"name": "v2", "separator": "/"},
        )
        array[...] = data
        scale = [1.0, 1.0, 500.0 * step, 0.25 * step, 0.25 * step]
        move = [0.0, 0.0, 100.0 * level, 0.125 * level, 0.0]
        datasets.append({
            "path": f"level{level}",
            "coordinateTransformations": [{"type": "scale", "scale": scale}, {"type": "translation", "translation": move}],
        })
    whole = [{"type": "scale", "scale": [0.5, 1.0, 1.0, 2.0, 2.0]}]
    group.attrs["multiscales"] = [
        {"version": "0.4", "name": "cells", "axes": axes + space, "datasets": datasets, "coordinateTransformations": whole}
    ]
    channels = [("DAPI", "0000FF", 10, 300), ("GFP", "00ff00", 20, 800)]
    group.attrs["omero"] = {
        "channels": [
            {"label": name, "color": colour, "window": {"start": low, "end": high, "min": 0, "max": 65535}}
            for name, colour, low, high in channels
        ]
    }
    labels = group.create_group("labels")
    labels.attrs["labels"] = ["nuclei"]
    nuclei = labels.create_group("nuclei")
    data = (numbers("uint16") % 3).astype("uint8")
    array = nuclei.create_array("0", shape=SHAPE, chunks=SHAPE, dtype="uint8", compressors=numcodecs.Zlib())
    array[...] = data
    nuclei.attrs["multiscales"] = [{
        "version": "0.4",
        "axes": space,
        "datasets": [{
            "path": "0",
            "coordinateTransformations": [{"type": "scale", "scale": [500.0, 0.5, 0.5]}],
        }],
    }]
    nuclei.attrs["image-label"] = {
        "version": "0.4",
        "colors": [{"label-value": 1, "rgba": [255, 0, 51, 255]}, {"label-value": 2, "rgba": [0, 255, 0, 255]}],
        "properties": [{"label-value": 1, "class": "round"}],
    }


def series(folder):
    """Two series, as bioformats2raw writes them."""
    group = zarr.open_group(folder, mode="w", zarr_format=2)
    group.attrs["bioformats2raw.layout"] = 3
    for index in range(2):
        one = group.create_group(str(index))
        shape = (3 + index, 4, 5)
        array = one.create_array("0", shape=shape, chunks=shape, dtype="uint8", compressors=None)
        array[...] = numbers("uint8", shape)
        axes = [{"name": name, "type": "space"} for name in "zyx"]
        one.attrs["multiscales"] = [
            {"version": "0.4", "name": f"series {index}", "axes": axes, "datasets": [{"path": "0"}]}
        ]


def main():
    out = Path(sys.argv[1])
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    for name in ["bool", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16", "float32",
                 "float64"]:
        write(out, f"v2_{name}", v2(name, None))
        write(out, f"v3_{name}", v3(name, None, chunks=SHAPE))
    write(out, "v2_big", v2(">u2", None))
    write(out, "v2_big_float", v2(">f4", numcodecs.GZip(5)))
    write(out, "v2_fortran", v2("<u2", numcodecs.Zlib(5), order="F", separator="/"))
    for cname in ["blosclz", "lz4", "lz4hc", "snappy", "zlib", "zstd"]:
        for shuffle in [0, 1, 2]:
            try:
                write(out, f"v2_blosc_{cname}_{shuffle}", v2("<u2", numcodecs.Blosc(cname, shuffle=shuffle)))
            except ValueError:
                print(f"numcodecs has no {cname}")
                break
    write(out, "v2_zstd", v2("<f8", numcodecs.Zstd(3)))
    write(out, "v3_auto", v3("float32"))
    codecs = zarr.codecs
    write(out, "v3_gzip", v3("uint16", [codecs.GzipCodec(level=5)], separator="."))
    write(out, "v3_zstd_checked", v3("uint16", [codecs.ZstdCodec(level=3, checksum=True), codecs.Crc32cCodec()]))
    write(out, "v3_blosc", v3("uint16", [codecs.BloscCodec(cname="zstd", shuffle="bitshuffle", typesize=2)]))
    write(out, "v3_big", v3("int32", None, serializer=codecs.BytesCodec(endian="big")))
    write(out, "v3_transposed", v3("uint16", None, filters=[codecs.TransposeCodec(order=(1, 2, 0))]))
    write(out, "v3_sharded", v3("uint16", [codecs.ZstdCodec()], chunks=(2, 3, 4), shards=(4, 6, 8)))
    # A chunk of zeros only is not stored.
    sparse = numbers("uint16")
    sparse[:3] = 77

    def missing(folder):
        array = zarr.create_array(folder, shape=SHAPE, chunks=(3, 4, 5), dtype="uint16", fill_value=77)
        array[...] = sparse

    write(out, "v3_missing", missing)

    def missing_in_shard(folder):
        array = zarr.create_array(
            folder, shape=SHAPE, chunks=(3, 5, 3), shards=(6, 10, 9), dtype="uint16", fill_value=77
        )
        array[...] = sparse

    write(out, "v3_missing_in_shard", missing_in_shard)
    write(out, "image", image)
    write(out, "series", series)
    print(zarr.__version__, numcodecs.__version__)


main()
