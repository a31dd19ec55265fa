"""One bright corner of an oblique block is at the same place of the world, whatever image it comes in."""

import types

import nibabel
import numpy
import pytest
import SimpleITK
import vtk
import xarray

import relume

SPACING = (0.5, 0.75, 2.0)
ORIGIN = (10.0, -20.0, 30.0)
ANGLE = 0.3
DIRECTION = numpy.array([[numpy.cos(ANGLE), -numpy.sin(ANGLE), 0], [numpy.sin(ANGLE), numpy.cos(ANGLE), 0], [0, 0, 1.0]])
AFFINE = numpy.eye(4)
AFFINE[:3, :3] = DIRECTION * SPACING
AFFINE[:3, 3] = ORIGIN
LPS_FROM_RAS = numpy.diag([-1.0, -1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def block():
    """3 × 4 × 5 voxels (x, y, z), of which (2, 0, 4) is bright."""
    block = numpy.arange(60, dtype=numpy.int16).reshape(5, 4, 3)
    block[4, 0, 2] = 1000
    return block


BRIGHT = AFFINE @ [2, 0, 4, 1]


def at_bright(volume, where=BRIGHT):
    """True if the bright voxel is at its place."""
    z, y, x = numpy.unravel_index(volume.array.argmax(), volume.array.shape)
    return numpy.allclose(volume.world((x, y, z)), where[:3], atol=1e-5)


def test_arrays_in_any_memory_order(block):
    geometry = {"spacing": SPACING, "origin": ORIGIN, "direction": DIRECTION}
    padded = numpy.zeros((10, 8, 6), numpy.int16)
    padded[::2, ::2, ::2] = block
    for array in (
        block,
        numpy.asfortranarray(block),
        padded[::2, ::2, ::2],
        block.astype(">i2"),
        block.astype(numpy.float16),
        block.tolist(),
        memoryview(block),
    ):
        volume = relume.Volume(array, **geometry)
        assert at_bright(volume) and volume.dims == (3, 4, 5)
        assert numpy.array_equal(volume.array, numpy.asarray(array))
    assert at_bright(relume.Volume(block.transpose(2, 1, 0), axes="xyz", **geometry))
    assert at_bright(relume.Volume(block, affine=AFFINE))
    assert at_bright(relume.Volume(relume.Volume(block, affine=AFFINE).array, affine=AFFINE))


@pytest.mark.parametrize("kind", ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8", "f4", "f8"])
def test_voxels_keep_their_type(kind):
    array = numpy.arange(24).reshape(2, 3, 4).astype(kind)
    volume = relume.Volume(array)
    assert volume.array.dtype == array.dtype and numpy.array_equal(volume.array, array)


def test_images_of_simpleitk(block):
    image = SimpleITK.GetImageFromArray(block)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    image.SetDirection(DIRECTION.ravel().tolist())
    volume = relume.Volume(image)
    assert at_bright(volume) and volume.unit == "mm" and volume.anatomical
    assert numpy.allclose(volume.affine, AFFINE)


def test_images_of_itk(block):
    """The methods of ITK's images, whose package is not a part of these tests."""

    class Image:
        def __array__(self, dtype=None, copy=None):
            return block

        def GetSpacing(self):
            return SPACING

        def GetOrigin(self):
            return ORIGIN

        def GetDirection(self):
            return DIRECTION

        def GetLargestPossibleRegion(self):
            return types.SimpleNamespace(GetSize=lambda: (3, 4, 5))

        def GetNumberOfComponentsPerPixel(self):
            return 1

    assert at_bright(relume.Volume(Image()))


def test_images_of_nibabel(block, tmp_path):
    ras = LPS_FROM_RAS @ AFFINE
    image = nibabel.Nifti1Image(block.transpose(2, 1, 0), ras)
    image.header.set_xyzt_units("mm")
    assert at_bright(relume.Volume(image))
    path = tmp_path / "block.nii.gz"
    nibabel.save(image, path)
    assert at_bright(relume.Volume(nibabel.load(path)))
    assert at_bright(relume.Volume(path)), "by Relume's own reader"
    scaled = nibabel.Nifti1Image(block.transpose(2, 1, 0) * 2.5 + 7, ras)
    scaled.header.set_data_dtype(numpy.int16)
    nibabel.save(scaled, path)
    volume = relume.Volume(nibabel.load(path))
    assert at_bright(volume) and volume.slope != 1
    values = volume.slope * volume.array + volume.intercept
    assert abs(values - (block * 2.5 + 7)).max() < 0.05


@pytest.mark.parametrize("dims", ["zyx", "xzy", "yxz"])
@pytest.mark.parametrize("flipped", ["", "x", "zy"])
def test_arrays_of_xarray(block, dims, flipped):
    places = {
        axis: ORIGIN[i] + SPACING[i] * numpy.arange(size) for i, (axis, size) in enumerate(zip("xyz", (3, 4, 5)))
    }
    data = xarray.DataArray(block, dims=list("zyx"), coords=places).transpose(*dims)
    data = data.isel({axis: slice(None, None, -1) for axis in flipped})
    data.coords["x"].attrs["units"] = "µm"
    volume = relume.Volume(data)
    straight = numpy.add(ORIGIN, numpy.multiply(SPACING, (2, 0, 4)))
    assert at_bright(volume, straight) and volume.unit == "µm"


def test_uneven_coordinates_are_refused(block):
    data = xarray.DataArray(block, dims=list("zyx"), coords={"x": [0, 1, 3]})
    with pytest.raises(relume.VolumeError, match="not even"):
        relume.Volume(data)


def test_images_of_vtk(block):
    from vtkmodules.util.numpy_support import numpy_to_vtk

    image = vtk.vtkImageData()
    image.SetDimensions(3, 4, 5)
    image.SetSpacing(SPACING)
    image.SetOrigin(ORIGIN)
    image.SetDirectionMatrix(DIRECTION.ravel().tolist())
    image.GetPointData().SetScalars(numpy_to_vtk(block.ravel(), deep=True))
    assert at_bright(relume.Volume(image))
    # The origin of an extent is that of the voxel (0, 0, 0), which it may leave out.
    image.SetExtent(2, 4, 1, 4, 3, 7)
    moved = AFFINE @ [4, 1, 7, 1]
    assert at_bright(relume.Volume(image), moved)


def test_scenes_take_any_image(block):
    image = SimpleITK.GetImageFromArray(block)
    scene = relume.Scene.first_look(image)
    assert scene.volume.dims == (3, 4, 5)


@pytest.mark.parametrize(
    ("array", "geometry", "sentence"),
    [
        (numpy.zeros((2, 3)), {}, "2 axes"),
        (numpy.zeros((2, 3, 4, 5)), {}, "4 axes"),
        (numpy.zeros((0, 3, 4)), {}, "4×3×0"),
        (numpy.zeros((2, 3, 4), complex), {}, "complex128"),
        (numpy.zeros((2, 3, 4), object), {}, "object"),
        (numpy.zeros((2, 3, 4)), {"spacing": (0, 1, 1)}, "spacing is 0 1 1"),
        (numpy.zeros((2, 3, 4)), {"spacing": (float("nan"), 1, 1)}, "spacing"),
        (numpy.zeros((2, 3, 4)), {"spacing": (1, 1)}, "2 numbers"),
        (numpy.zeros((2, 3, 4)), {"affine": numpy.zeros((4, 4))}, "places no voxels"),
        (numpy.zeros((2, 3, 4)), {"affine": numpy.eye(3)}, r"\(3, 3\)"),
        (numpy.zeros((2, 3, 4)), {"direction": [[1, 1, 0], [0, 1, 0], [0, 0, 1]]}, "orthogonal|perpendicular|orthonormal"),
        (numpy.zeros((2, 3, 4)), {"unit": "parsec"}, "parsec"),
        (numpy.zeros((2, 3, 4)), {"axes": "zzz"}, "zzz"),
        (numpy.zeros((2, 3, 4)), {"spacing": "1,1,1"}, "three numbers"),
        (numpy.ma.masked_less(numpy.zeros((2, 3, 4)), 1), {}, "filled"),
    ],
)
def test_what_is_no_volume_is_refused(array, geometry, sentence):
    with pytest.raises(relume.VolumeError, match=sentence):
        relume.Volume(array, **geometry)


def test_what_is_no_image_is_refused():
    with pytest.raises(TypeError, match="no image"):
        relume.Volume(object())


def test_a_scene_of_channels_is_pickled_with_all_of_them():
    import copy
    import pathlib
    import pickle

    file = pathlib.Path(__file__).parents[2] / "tests" / "data" / "tiff" / "channels.ome.tif"
    scene = relume.open(file)
    again = pickle.loads(pickle.dumps(scene))
    assert again == scene and copy.deepcopy(scene) == scene
    film = scene.render((16, 16), device="cpu")
    assert (again.render((16, 16), device="cpu").weights == film.weights).all()
    assert scene.define({"volumes.GFP.transfer.opacity": [[0, 0], [9, 0.1]]}) != scene
