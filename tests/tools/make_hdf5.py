"""Writes the HDF5 and NetCDF files of tests/data/hdf5, with h5py and netCDF4.

    python3 tests/tools/make_hdf5.py tests/data/hdf5

The number of voxel (x, y, z) in channel c at time t is n = x*x + 7*y + 40*z + 300*c + 1000*t; its value in a type is
n % 251 (8 bits), n (16 to 64 bits), n / 8 (floats), n % 3 == 0 (bool).
"""

import json
import shutil
import sys
from pathlib import Path

import h5py
import netCDF4
import numpy as np

from arrays import SHAPE, numbers


def types(path, libver):
    with h5py.File(path, "w", libver=libver) as file:
        for name in ["bool", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16", "float32",
                     "float64"]:
            file.create_dataset(f"little/{name}", data=numbers(name))
            if name != "bool":
                file.create_dataset(f"big/{name}", data=numbers(name).astype(np.dtype(name).newbyteorder(">")))
        # Neither of these is a volume.
        file["words"] = "text"
        file["line"] = np.arange(5)


def codings(path, libver):
    with h5py.File(path, "w", libver=libver) as file:
        data = numbers("uint16")
        for name, options in {
            "gzip": {"compression": "gzip", "shuffle": True, "fletcher32": True},
            "lzf": {"compression": "lzf"},
            "lzf_shuffle": {"compression": "lzf", "shuffle": True},
            "scaleoffset": {"scaleoffset": 0},
            "chunked": {},
            "unlimited": {"compression": "gzip", "maxshape": (None, None, None)},
        }.items():
            file.create_dataset(name, data=data, chunks=(3, 4, 5), **options)
        # A chunk that was never written has the fill value.
        sparse = file.create_dataset("sparse", SHAPE, "uint16", chunks=(3, 4, 5), fillvalue=77)
        sparse[3:] = data[3:]


def single(path):
    with h5py.File(path, "w") as file:
        volume = file.create_dataset("exported_data", data=numbers("uint8"), chunks=(4, 4, 4), compression="gzip")
        volume.attrs["element_size_um"] = [2.0, 0.5, 0.25]
        volume.attrs["long_name"] = "nuclei"


def four(path):
    with h5py.File(path, "w") as file:
        file.create_dataset("a", data=numbers("uint16", (2,) + SHAPE), chunks=(1, 3, 4, 5), compression="lzf")


def ilastik(path):
    with h5py.File(path, "w") as file:
        image = file.create_dataset("exported_data", data=np.moveaxis(numbers("uint16", (2,) + SHAPE), 0, -1))
        image.attrs["axistags"] = json.dumps(
            {"axes": [{"key": key, "typeFlags": 2, "resolution": 0, "description": ""} for key in "zyxc"]}
        )


def netcdf(path, format):
    with netCDF4.Dataset(path, "w", format=format) as file:
        lengths = {"t": 2, "depth": 7, "y": 10, "x": 9}
        for name, length in lengths.items():
            file.createDimension(name, length)
        for name, first, step, unit in [("depth", 40.0, -2000.0, "um"), ("y", 5.0, 1.5, "mm"), ("x", -3.0, 0.5, "mm")]:
            line = file.createVariable(name, "f4" if name == "y" else "f8", (name,))
            line[:] = first + step * np.arange(lengths[name])
            line.units = unit
        kelvin = file.createVariable("kelvin", "i2", ("t", "depth", "y", "x"))
        kelvin.set_auto_maskandscale(False)
        kelvin[:] = numbers("int16", (2, 1) + SHAPE)[:, 0]
        kelvin.scale_factor = 0.25
        kelvin.add_offset = 200.0
        kelvin.long_name = "temperature"
        wind = file.createVariable("wind", "f4", ("depth", "y", "x"), fill_value=-999.0)
        wind.set_auto_maskandscale(False)
        data = numbers("float32")
        data[0, 0, 0] = -999
        wind[:] = data


def minc(path):
    with h5py.File(path, "w") as file:
        for index, name in enumerate(["xspace", "yspace", "zspace"]):
            line = file.create_dataset(f"minc-2.0/dimensions/{name}", data=0)
            line.attrs["step"] = [1.5, -2.0, 3.0][index]
            line.attrs["start"] = [-10.0, 20.0, 30.0][index]
            line.attrs["direction_cosines"] = [[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]][index]
            line.attrs["units"] = "mm"
        image = file.create_dataset("minc-2.0/image/0/image", data=numbers("uint16"), chunks=(7, 5, 9), compression="gzip")
        image.attrs["dimorder"] = "zspace,yspace,xspace"


def scaled_minc(path, slices):
    """Stored numbers of 16 bits whose valid range is 0 to 4000; each slice, or all of them, have ends of their own."""
    with h5py.File(path, "w") as file:
        for name in ["xspace", "yspace", "zspace"]:
            file.create_dataset(f"minc-2.0/dimensions/{name}", data=0).attrs["step"] = 1.0
        group = file.create_group("minc-2.0/image/0")
        image = group.create_dataset("image", data=numbers("uint16"), chunks=(7, 5, 9), compression="gzip")
        image.attrs["dimorder"] = "zspace,yspace,xspace"
        image.attrs["valid_range"] = [0.0, 4000.0]
        for name, first, step in [("image-min", -10.0, 1.0), ("image-max", 90.0, 11.0)]:
            ends = first + step * np.arange(SHAPE[0]) if slices else first
            group.create_dataset(name, data=ends).attrs["dimorder"] = "zspace" if slices else ""


def characters(text):
    return np.array(list(text), dtype="S1")


def imaris(path):
    with h5py.File(path, "w") as file:
        image = file.create_group("DataSetInfo/Image")
        values = {"X": 9, "Y": 10, "Z": 7, "Unit": "um", "ExtMin0": -1.0, "ExtMin1": 0.0, "ExtMin2": 4.0, "ExtMax0": 3.5,
                  "ExtMax1": 5.0, "ExtMax2": 11.0}
        for key, value in values.items():
            image.attrs[key] = characters(str(value))
        for index, (name, colour) in enumerate([("DAPI", "0.000 0.000 1.000"), ("GFP", "0.000 1.000 0.000")]):
            channel = file.create_group(f"DataSetInfo/Channel {index}")
            channel.attrs["Name"] = characters(name)
            channel.attrs["Color"] = characters(colour)
            channel.attrs["ColorRange"] = characters("10.000 250.000")
        for level in range(2):
            step = 2**level
            for time in range(2):
                for channel in range(2):
                    group = file.create_group(f"DataSet/ResolutionLevel {level}/TimePoint {time}/Channel {channel}")
                    data = numbers("uint16", (2, 2) + SHAPE)[time, channel, ::step, ::step, ::step]
                    for key, size in zip(["ImageSizeZ", "ImageSizeY", "ImageSizeX"], data.shape):
                        group.attrs[key] = characters(str(size))
                    padded = np.zeros([-(-side // 8) * 8 for side in data.shape], "uint16")
                    padded[tuple(slice(side) for side in data.shape)] = data
                    group.create_dataset("Data", data=padded, chunks=(8, 8, 8), compression="gzip")


def links(path, target):
    with h5py.File(target, "w") as file:
        file.create_dataset("one", data=numbers("uint16", (2,) + SHAPE)[1])
        file.create_dataset("group/deep/two", data=numbers("uint16", (3,) + SHAPE)[2], chunks=(7, 5, 9), compression="gzip")
    with h5py.File(path, "w", libver="latest") as file:
        file.create_dataset("detector/frames", data=numbers("uint16"))
        file["entry/data"] = h5py.SoftLink("/detector/frames")
        file["entry/alias"] = h5py.SoftLink("/detector")
        file["outside/one"] = h5py.ExternalLink(target.name, "/one")
        file["outside/all"] = h5py.ExternalLink(target.name, "/group")
        file["outside/gone"] = h5py.ExternalLink("no_such.h5", "/one")
        file["outside/away"] = h5py.ExternalLink("../single.h5", "/exported_data")


def emd(path):
    with h5py.File(path, "w") as file:
        group = file.create_group("data/volume")
        group.attrs["emd_group_type"] = 1
        group.create_dataset("data", data=numbers("uint16"))
        for index, (name, unit, line) in enumerate([("z", "[A]", [10.0, 13.0]), ("y", "[n_m]", 0.5 * np.arange(10)),
                                                    ("x", "[n_m]", 4 + 0.25 * np.arange(9))]):
            axis = group.create_dataset(f"dim{index + 1}", data=line)
            axis.attrs["name"] = name
            axis.attrs["units"] = unit.replace("[A]", "Å")


def bare(path):
    """NetCDF-4 as its library writes it: dimensions without variables are arrays that say so."""
    with h5py.File(path, "w", track_order=True) as file:
        scales = []
        for index, length in enumerate(SHAPE):
            scale = file.create_dataset("zyx"[index], data=np.zeros(length, ">f4"))
            scale.make_scale(f"This is a netCDF dimension but not a netCDF variable{length:>10}")
            scale.attrs["_Netcdf4Dimid"] = np.int32(index)
            scales.append(scale)
        field = file.create_dataset("field", data=numbers("uint8").view("int8"))
        for index, scale in enumerate(scales):
            field.dims[index].attach_scale(scale)
        field.attrs["_Unsigned"] = "true"
        field.attrs["scale_factor"] = 0.5
        field.attrs["add_offset"] = -3.0


def main():
    out = Path(sys.argv[1])
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    types(out / "types.h5", "earliest")
    codings(out / "codings.h5", "earliest")
    codings(out / "codings_latest.h5", "latest")
    single(out / "single.h5")
    four(out / "four.h5")
    ilastik(out / "ilastik.h5")
    netcdf(out / "netcdf4.nc", "NETCDF4")
    netcdf(out / "netcdf3.nc", "NETCDF3_CLASSIC")
    netcdf(out / "netcdf3_offset64.nc", "NETCDF3_64BIT_OFFSET")
    netcdf(out / "netcdf3_data64.nc", "NETCDF3_64BIT_DATA")
    minc(out / "minc.mnc")
    scaled_minc(out / "minc_slices.mnc", True)
    scaled_minc(out / "minc_scale.mnc", False)
    imaris(out / "imaris.ims")
    links(out / "links.h5", out / "links_target.h5")
    emd(out / "emd.emd")
    bare(out / "netcdf4_bare.nc")
    print(h5py.__version__, netCDF4.__version__)


main()
