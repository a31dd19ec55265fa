"""Arrays out are views that live as long as anyone looks; arrays in are copied once."""

import gc
import pickle
import resource
import time
import weakref

import numpy
import pytest

import relume


def test_numbers_are_views_that_outlive_their_names(scene):
    film = scene.render((96, 64))
    weights, transmittance = film.weights, film.transmittance
    assert weights.shape == (2, 2, 64, 96) and weights.dtype == numpy.float32
    assert transmittance.shape == (1, 64, 96) and transmittance.dtype == numpy.float32
    assert weights.base is film and not weights.flags.writeable and not weights.flags.owndata
    with pytest.raises(ValueError):
        weights[0] = 1
    with pytest.raises(ValueError):
        weights.flags.writeable = True
    kept = weights.copy()
    del film, transmittance
    gc.collect()
    scene.render((96, 64))
    assert numpy.array_equal(weights, kept)
    assert weights.max() > 0.1


def test_a_view_takes_no_time(film):
    film.weights
    times = []
    for _ in range(200):
        start = time.perf_counter()
        film.weights
        times.append(time.perf_counter() - start)
    assert min(times) < 50e-6


def test_a_picture_is_its_matrices_times_its_numbers(film):
    colours, behind = film.matrices("A")
    picture = numpy.einsum("pcyx,pck->yxk", film.weights, colours)
    picture += numpy.einsum("nyx,nk->yxk", film.transmittance, behind)
    assert abs(picture - film.relight("A")[..., :3]).max() < 1e-6


def test_pictures_are_written_into_an_array_of_the_caller(film):
    out = numpy.zeros((64, 96, 4), numpy.float32)
    assert film.relight("A", out=out) is out
    assert numpy.array_equal(out, film.relight("A"))
    for wrong in (numpy.zeros((64, 96, 3), "f4"), numpy.zeros((64, 96, 4)), out[:, ::-1], "text"):
        with pytest.raises((TypeError, ValueError)):
            film.relight("A", out=wrong)
    out.flags.writeable = False
    with pytest.raises(ValueError):
        film.relight("A", out=out)


def test_films_of_a_loop_leave_no_memory(scene):
    def peak():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    for _ in range(10):
        scene.render((64, 64)).relight("A")
    before = peak()
    for _ in range(100):
        scene.render((64, 64)).relight("A")
    assert peak() - before < 20_000, "kB"


def test_the_array_of_a_volume_is_its_voxels(ball):
    volume = relume.Volume(ball)
    assert numpy.array_equal(volume.array, ball) and volume.array.base is volume
    assert not volume.array.flags.writeable
    assert volume.range == (ball.min(), ball.max()) and volume.shape == ball.shape and volume.dtype == ball.dtype
    assert numpy.array_equal(numpy.asarray(volume), ball) and volume.affine.shape == (4, 4)
    gone = weakref.ref(ball.copy())
    assert gone() is None, "the test keeps nothing"


@pytest.mark.parametrize("table", ["", "spacing = [1, 1, 2]", "downsample = [2, 2, 2]", "origin = [5, 0, 0]"])
def test_labels_stay_with_the_voxels(ball, table):
    text = f"""version = 1
[volume]
{table}
[materials.bone]
reflectance = 0.8
[labels.1]
material = "bone"
opacity = 0.5
[lights.day]
spectrum = "D65"
kind = "headlight"
"""
    geometry = {"spacing": (1, 1, 1.2), "origin": (3, 2, 1), "unit": "mm", "anatomical": True}
    labels = relume.Volume((ball > 700).astype("u1"), **geometry)
    scene = relume.Scene(text, relume.Volume(ball, **geometry), labels)
    kept = scene.labels.array.copy()
    turned = scene.define({"camera.azimuth": 10}).define({"camera.azimuth": 20})
    assert numpy.array_equal(turned.labels.array, kept) and turned.labels.notes == scene.labels.notes
    assert turned.labels.array.ctypes.data == scene.labels.array.ctypes.data
    assert numpy.array_equal(pickle.loads(pickle.dumps(scene)).labels.array, kept)
    assert turned.define({"camera.azimuth": 30}).render((32, 32)) == scene.define({"camera.azimuth": 30}).render((32, 32))


def test_scenes_of_other_keys_share_the_volume(scene):
    turned = scene.define({"camera.azimuth": 40, "display": {"exposure": 2}})
    assert turned.volume.array.ctypes.data == scene.volume.array.ctypes.data
    assert turned != scene and turned.define({"camera.azimuth": 40}) == turned
    spaced = scene.define({"volume.spacing": [1, 1, 3]})
    assert spaced.volume.spacing == (1, 1, 3)
