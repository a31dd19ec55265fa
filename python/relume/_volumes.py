"""Voxels of an image and their place in the world, by the methods of the object; no package of an object is imported."""

import difflib
import os

import numpy

from ._errors import VolumeError

#: Axes of an array, slowest first.
AXES = "zyx"

#: From right-anterior-superior, as of nibabel, to left-posterior-superior, as of DICOM and ITK.
LPS_FROM_RAS = numpy.diag([-1.0, -1.0, 1.0, 1.0])


#: What `Volume` takes beside an image, and beside a path.
GEOMETRY = (
    "spacing", "origin", "direction", "affine", "axes", "unit", "anatomical", "labels", "slope", "intercept", "source"
)  # fmt: skip
OF_FILES = ("series", "time", "component", "array", "resample")


def recognised(image, **stated):
    """The path of a file, or a dict of `array` (z, y, x) and its geometry. What is stated takes the place of what the
    image has."""
    for name in stated:
        if name not in GEOMETRY + OF_FILES:
            near = difflib.get_close_matches(name, GEOMETRY + OF_FILES, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise TypeError(f"Volume takes no {name!r}{hint} It takes {', '.join(GEOMETRY)}; for a path {', '.join(OF_FILES)}")
    stated = {key: value for key, value in stated.items() if value is not None}
    if isinstance(image, (str, os.PathLike)):
        if any(name in GEOMETRY for name in stated):
            raise TypeError(
                "a file has its own geometry; read it, then state another one: "
                "Volume(volume.array, spacing=…), or scene.define({'volume.spacing': …})"
            )
        return os.fspath(image)
    for name in stated:
        if name in OF_FILES:
            raise TypeError(f"{name} chooses among the volumes of a file; choose a part of an array by its index")
    affine, axes = stated.pop("affine", None), stated.pop("axes", None)
    if affine is not None and any(key in stated for key in ("spacing", "origin", "direction")):
        raise TypeError("give an affine, or spacing, origin and direction")
    found = _found(image, axes)
    if affine is not None:
        found.update(_of_affine(affine))
    for key in ("spacing", "origin"):
        if key in stated:
            stated[key] = _three(key, stated[key])
    if "direction" in stated:
        matrix = numpy.asarray(stated["direction"], dtype=float)
        if matrix.shape != (3, 3):
            raise VolumeError(f"a direction is a matrix of 3 × 3, not {matrix.shape}", "volume-direction")
        stated["direction"] = matrix.tolist()
    found.update(stated)
    found["array"] = _plain(found["array"])
    return found


def _three(name, numbers):
    try:
        numbers = [float(number) for number in numpy.ravel(numbers)]
    except (TypeError, ValueError):
        raise VolumeError(f"{name} {numbers!r}: it takes three numbers, of x, y and z", f"volume-{name}") from None
    if len(numbers) == 1 and name == "spacing":
        numbers = numbers * 3
    if len(numbers) != 3:
        raise VolumeError(f"{name} has {len(numbers)} numbers; it takes three, of x, y and z", f"volume-{name}")
    return numbers


def _found(image, axes):
    """Array (z, y, x) and geometry by what the object has."""
    if hasattr(image, "GetPointData") and hasattr(image, "GetDimensions"):
        return _of_vtk(image)
    if hasattr(image, "GetSpacing") and hasattr(image, "GetDirection"):
        return _of_itk(image)
    if hasattr(image, "affine") and hasattr(image, "dataobj"):
        return _of_nibabel(image)
    if hasattr(image, "dims") and hasattr(image, "coords"):
        if not hasattr(image, "data"):
            raise TypeError(f"a dataset has several arrays; give one of them: {', '.join(map(str, image))}")
        return _of_xarray(image)
    if numpy.ma.isMaskedArray(image) and numpy.ma.getmaskarray(image).any():
        raise VolumeError("the array has a mask, and a volume none; fill it first: array.filled(value)", "volume-type")
    if hasattr(image, "__array__") or isinstance(image, (list, tuple)):
        array = numpy.asarray(image)
    elif hasattr(image, "__dlpack__"):
        array = numpy.from_dlpack(image)
    else:
        array = _of_buffer(image)
    if array is None:
        kind = f"{type(image).__module__}.{type(image).__qualname__}"
        raise TypeError(
            f"{kind} is no image: give an array (z, y, x), an image of SimpleITK, ITK, nibabel, xarray, VTK or PyVista, "
            "or a path"
        )
    return {"array": _turned(array, axes or AXES)}


def _of_buffer(image):
    """The array of an object with a buffer, such as a memoryview; `None` without one."""
    try:
        return numpy.asarray(memoryview(image))
    except TypeError:
        return None


def _turned(array, axes):
    """The array with its `axes` in the order z, y, x."""
    if sorted(axes) != sorted(AXES):
        raise VolumeError(f"axes {axes!r}: write the letters x, y and z in the order of the array's axes", "volume-axes")
    if array.ndim != 3:
        way = "a slice becomes a volume by array[None]" if array.ndim < 3 else "choose a channel or a time, such as array[0] or, where it is the last axis, array[..., 0]"
        raise VolumeError(f"the array has {array.ndim} axes {array.shape}, and a volume has three; {way}", "volume-axes")
    return array.transpose([axes.index(axis) for axis in AXES])


def _plain(array):
    """The array in a type of voxels, in C order and in the byte order of the machine."""
    if array.dtype == bool:
        array = array.astype(numpy.uint8)
    elif array.dtype == numpy.float16:
        array = array.astype(numpy.float32)
    elif array.dtype.kind == "f" and array.dtype.itemsize > 8:
        array = array.astype(numpy.float64)
    if array.dtype.kind not in "iuf":
        raise VolumeError(
            f"voxels of the type {array.dtype} are no numbers; take a part, such as abs(array) of complex ones",
            "volume-type",
        )
    return numpy.ascontiguousarray(array, dtype=array.dtype.newbyteorder("="))


def _of_affine(affine):
    """Spacing, origin and direction of a matrix of 4 × 4, world from voxel (x, y, z)."""
    affine = numpy.asarray(affine, dtype=float)
    if affine.shape != (4, 4):
        raise VolumeError(f"an affine is a matrix of 4 × 4, not {affine.shape}", "volume-affine")
    columns = affine[:3, :3]
    spacing = numpy.linalg.norm(columns, axis=0)
    with numpy.errstate(all="ignore"):
        direction = columns / spacing
    if not numpy.isfinite(direction).all():
        raise VolumeError(f"an affine with a spacing of {spacing.tolist()} places no voxels", "volume-affine")
    return {"spacing": spacing.tolist(), "origin": affine[:3, 3].tolist(), "direction": direction.tolist()}


def _of_itk(image):
    """Images of SimpleITK and ITK: arrays z, y, x; geometry x, y, z in left-posterior-superior millimetres."""
    if hasattr(image, "GetPixelIDTypeAsString"):
        import sys

        array = sys.modules["SimpleITK"].GetArrayViewFromImage(image)
        size = image.GetSize()
        direction = numpy.reshape(image.GetDirection(), (image.GetDimension(), image.GetDimension()))
        components = image.GetNumberOfComponentsPerPixel()
    else:
        array = numpy.asarray(image)
        size = tuple(image.GetLargestPossibleRegion().GetSize())
        direction = numpy.asarray(image.GetDirection())
        components = image.GetNumberOfComponentsPerPixel()
    if len(size) != 3 or components != 1:
        raise VolumeError(
            f"the image has {len(size)} axes and {components} components a voxel; a volume has three and one: choose a time, "
            "such as image[..., 0], or a component, such as SimpleITK.VectorIndexSelectionCast(image, 0)",
            "volume-axes",
        )
    return {
        "array": array,
        "spacing": [float(length) for length in image.GetSpacing()],
        "origin": [float(place) for place in image.GetOrigin()],
        "direction": direction.tolist(),
        "unit": "mm",
        "anatomical": True,
    }


def _of_nibabel(image):
    """Images of nibabel: arrays x, y, z; the affine is right-anterior-superior. Scaled values stay as stored."""
    proxy = image.dataobj
    if len(image.shape) != 3:
        raise VolumeError(
            f"the image has the shape {image.shape}; choose a time, such as image.slicer[..., 0]", "volume-axes"
        )
    found = _of_affine(LPS_FROM_RAS @ image.affine)
    if hasattr(proxy, "get_unscaled"):
        found["array"] = numpy.asarray(proxy.get_unscaled())
        found["slope"], found["intercept"] = float(proxy.slope), float(proxy.inter)
    else:
        found["array"] = numpy.asarray(proxy)
    found["array"] = _turned(found["array"], "xyz")
    units = getattr(image.header, "get_xyzt_units", lambda: ("mm", None))()[0]
    known = {"mm": "mm", "micron": "µm", "meter": None, "unknown": None}
    if known.get(units):
        found["unit"] = known[units]
    found["anatomical"] = True
    return found


def _of_xarray(data):
    """Arrays of xarray: dimensions x, y and z in any order; even coordinates give spacing and origin."""
    names = {str(name).lower(): name for name in data.dims}
    if len(data.dims) != 3 or sorted(names) != sorted(AXES):
        raise VolumeError(
            f"the array has the dimensions {tuple(data.dims)}; a volume has x, y and z: choose one with "
            "isel(), rename the others",
            "volume-axes",
        )
    spacing, origin = [], []
    for axis in "xyz":
        name = names[axis]
        if name not in data.coords or data.sizes[name] < 2:
            places = numpy.asarray(data.coords[name], dtype=float) if name in data.coords else [0.0]
            spacing.append(1.0)
            origin.append(float(places[0]))
            continue
        places = numpy.asarray(data.coords[name], dtype=float)
        steps = numpy.diff(places)
        step = (places[-1] - places[0]) / (len(places) - 1)
        if not numpy.allclose(steps, step, rtol=1e-3, atol=0):
            raise VolumeError(
                f"the coordinates of {name} are not even: their steps are {steps.min()} to {steps.max()}; interpolate "
                "them, or drop them with drop_vars()",
                "volume-spacing",
            )
        if step < 0:
            data = data.isel({name: slice(None, None, -1)})
            places, step = places[::-1], -step
        spacing.append(float(step))
        origin.append(float(places[0]))
    array = numpy.asarray(data.transpose(*(names[axis] for axis in AXES)).data)
    found = {"array": array, "spacing": spacing, "origin": origin}
    unit = data.coords[names["x"]].attrs.get("units") if names["x"] in data.coords else None
    if unit in ("cm", "mm", "µm", "um", "nm"):
        found["unit"] = unit
    return found


def _of_vtk(image):
    """Images of VTK and PyVista: x fastest, the active scalars of the points."""
    scalars = image.GetPointData().GetScalars()
    if scalars is None:
        raise VolumeError("the image has no active scalars at its points; set them, or give an array", "volume-type")
    if scalars.GetNumberOfComponents() != 1:
        count = scalars.GetNumberOfComponents()
        raise VolumeError(f"the scalars have {count} components; choose one", "volume-axes")
    try:
        array = numpy.asarray(scalars)
    except (TypeError, ValueError):
        array = None
    if array is None or array.dtype == object:
        from vtkmodules.util.numpy_support import vtk_to_numpy

        array = vtk_to_numpy(scalars)
    x, y, z = image.GetDimensions()
    found = {
        "array": array.reshape(z, y, x),
        "spacing": [float(length) for length in image.GetSpacing()],
        "origin": [float(place) for place in image.GetOrigin()],
    }
    if hasattr(image, "GetExtent"):
        # The origin is the place of the voxel (0, 0, 0), which an extent may leave out.
        low = image.GetExtent()[::2]
        offset = numpy.multiply(low, found["spacing"])
    else:
        offset = numpy.zeros(3)
    if hasattr(image, "GetDirectionMatrix"):
        matrix = image.GetDirectionMatrix()
        rows = [[matrix.GetElement(i, j) for j in range(3)] for i in range(3)]
        found["direction"] = rows
        offset = numpy.matmul(rows, offset)
    found["origin"] = (numpy.asarray(found["origin"]) + offset).tolist()
    return found
