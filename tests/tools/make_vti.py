"""Writes the files of tests/data/vti with VTK's own writer: python3 make_vti.py FOLDER (needs vtk and numpy).

The grid has 5 x 4 x 3 points. The value of point or cell number n, counted with x fastest, is in a file of type

    UInt8     4n + 1               Int8      4n - 118
    UInt16    259 (4n + 1)         Int16     259 (4n - 118)
    UInt32    259 * 65539 (4n + 1) Int32     259 * 65539 (4n - 118)
    UInt64    259 * 65539 * 4294967311 (4n + 1), Int64 likewise with 4n - 118
    Float32   (4n - 118) / 8       Float64   (4n - 118) / 8

and component c of several has c added. No two bytes of a wide number are alike everywhere, so a wrong order shows.
"""

import sys

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk
from vtk.util.vtkAlgorithm import VTKPythonAlgorithmBase

DIMS = (5, 4, 3)
TYPES = {
    "UInt8": (np.uint8, 1),
    "UInt16": (np.uint16, 259),
    "UInt32": (np.uint32, 259 * 65539),
    "UInt64": (np.uint64, 259 * 65539 * 4294967311),
    "Int8": (np.int8, 1),
    "Int16": (np.int16, 259),
    "Int32": (np.int32, 259 * 65539),
    "Int64": (np.int64, 259 * 65539 * 4294967311),
    "Float32": (np.float32, 1 / 8),
    "Float64": (np.float64, 1 / 8),
}


def values(kind, number, components=1):
    dtype, factor = TYPES[kind]
    first = 1 if kind.startswith("U") else -118
    column = [dtype(factor * (4 * n + first)) for n in range(number)]
    return np.array([[value + dtype(c) for c in range(components)] for value in column], dtype=dtype)


def array(name, kind, number=60, components=1):
    made = numpy_to_vtk(values(kind, number, components), deep=1)
    made.SetName(name)
    return made


def image(extent=(0, 4, 0, 3, 0, 2)):
    made = vtk.vtkImageData()
    made.SetExtent(*extent)
    made.SetOrigin(10, 20, 30)
    made.SetSpacing(1, 2, 3)
    return made


def scalars(kind, **where):
    made = image(**where)
    made.GetPointData().SetScalars(array("ct", kind))
    return made


class Parts(VTKPythonAlgorithmBase):
    """Makes of an image only the points and cells that are asked for, so that the writer writes pieces."""

    def __init__(self, whole):
        super().__init__(nInputPorts=0, outputType="vtkImageData")
        self.whole = whole

    def RequestInformation(self, request, inputs, outputs):
        information = outputs.GetInformationObject(0)
        information.Set(vtk.vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT(), self.whole.GetExtent(), 6)
        information.Set(vtk.vtkDataObject.ORIGIN(), self.whole.GetOrigin(), 3)
        information.Set(vtk.vtkDataObject.SPACING(), self.whole.GetSpacing(), 3)
        direction = self.whole.GetDirectionMatrix().GetData()
        information.Set(vtk.vtkDataObject.DIRECTION(), direction, 9)
        information.Set(vtk.vtkAlgorithm.CAN_PRODUCE_SUB_EXTENT(), 1)
        return 1

    def RequestData(self, request, inputs, outputs):
        asked = outputs.GetInformationObject(0).Get(vtk.vtkStreamingDemandDrivenPipeline.UPDATE_EXTENT())
        made = vtk.vtkImageData.GetData(outputs, 0)
        made.DeepCopy(self.whole)
        made.Crop(asked)
        return 1


def write(folder, name, data, mode="binary", compressor="none", big=False, wide=False, blocks=None, pieces=1):
    writer = vtk.vtkXMLImageDataWriter()
    writer.SetFileName(f"{folder}/{name}.vti")
    if pieces == 1:
        writer.SetInputData(data)
    else:
        source = Parts(data)
        writer.SetInputConnection(source.GetOutputPort())
    writer.SetDataMode({"ascii": 0, "binary": 1}.get(mode, 2))
    writer.SetEncodeAppendedData(mode == "base64")
    made = {
        "none": None,
        "zlib": vtk.vtkZLibDataCompressor(),
        "lz4": vtk.vtkLZ4DataCompressor(),
        "lzma": vtk.vtkLZMADataCompressor(),
    }[compressor]
    writer.SetCompressor(made)
    writer.SetByteOrder(0 if big else 1)
    writer.SetHeaderType(64 if wide else 32)
    if blocks:
        writer.SetBlockSize(blocks)
    writer.SetNumberOfPieces(pieces)
    assert writer.Write() == 1, name


folder = sys.argv[1]
for mode in ("ascii", "binary", "raw", "base64"):
    for compressor in ("none", "zlib", "lz4", "lzma"):
        if mode == "ascii" and compressor != "none":
            continue
        # 120 bytes: four blocks, the last of them shorter; and one block.
        write(folder, f"{mode}_{compressor}_little_32", scalars("Int16"), mode, compressor, blocks=32)
        write(folder, f"{mode}_{compressor}_big_64", scalars("Int16"), mode, compressor, big=True, wide=True)
for kind in TYPES:
    write(folder, f"type_{kind}", scalars(kind), "binary", "zlib", big=kind.startswith("U"))
    write(folder, f"ascii_{kind}", scalars(kind), "ascii")

turned = scalars("UInt8", extent=(2, 6, -1, 2, 3, 5))
turned.SetDirectionMatrix(0, -1, 0, 1, 0, 0, 0, 0, 1)
cells = array("cells", "Float32", 4 * 3 * 2)
turned.GetCellData().AddArray(cells)
time = vtk.vtkDoubleArray()
time.SetName("TimeValue")
time.InsertNextValue(1.5)
turned.GetFieldData().AddArray(time)
write(folder, "turned", turned, "raw", "zlib")
# Neighbours share a layer of points.
write(folder, "pieces", turned, "raw", "lz4", pieces=3)
write(folder, "pieces_binary", turned, "binary", "zlib", big=True, pieces=2)

only_cells = image()
only_cells.GetCellData().AddArray(cells)
write(folder, "cells", only_cells)

flat = image(extent=(0, 4, 0, 3, 7, 7))
flat.GetCellData().AddArray(array("cells", "UInt8", 4 * 3))
write(folder, "flat_cells", flat)

several = image()
several.GetPointData().AddArray(array("ct", "UInt16"))
several.GetPointData().AddArray(array("flow", "Float32", components=3))
several.GetCellData().AddArray(array("labels", "UInt8", 4 * 3 * 2))
several.GetCellData().AddArray(array("ct", "Int8", 4 * 3 * 2))
write(folder, "several", several, "base64", "zlib")

# Tags between and inside arrays: strings, bits, the range of a vector's length, a component's name.
tags = image()
notes = vtk.vtkStringArray()
notes.SetName("notes")
notes.InsertNextValue("a < b & c")
tags.GetFieldData().AddArray(notes)
bits = vtk.vtkBitArray()
bits.SetName("bits")
bits.SetNumberOfValues(60)
bits.Fill(1)
tags.GetPointData().AddArray(bits)
for kind in ("Float32", "UInt16"):
    vectors = array(f"flow_{kind}", kind, components=3)
    vectors.GetRange(-1)
    vectors.SetComponentName(0, "along <x>")
    tags.GetPointData().AddArray(vectors)
tags.GetCellData().SetScalars(array("labels", "UInt8", 4 * 3 * 2))
write(folder, "tags_ascii", tags, "ascii")
write(folder, "tags_binary", tags, "binary", "zlib")

# The same points at three times; c is added at time c.
later = image()
writer = vtk.vtkXMLImageDataWriter()
writer.SetFileName(f"{folder}/times.vti")
writer.SetInputData(later)
writer.SetNumberOfTimeSteps(3)
writer.Start()
for step in range(3):
    later.GetPointData().SetScalars(numpy_to_vtk(values("UInt8", 60) + np.uint8(step), deep=1))
    later.GetPointData().GetScalars().SetName("ct")
    later.Modified()
    writer.WriteNextTime(0.5 * step)
writer.Stop()
