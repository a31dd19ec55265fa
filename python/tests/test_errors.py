"""Errors have classes, codes and keys; nothing that is given panics."""

import warnings

import numpy
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import relume


def key(scene, definitions):
    error = pytest.raises(relume.SceneError, scene.define, definitions).value
    assert isinstance(error, (relume.RelumeError, ValueError)) and error.code
    return error.key


def test_errors_name_the_key(scene, ball):
    assert key(scene, {"lights.day.direction": [0, 0, 0]}) == "lights.day.direction"
    assert key(scene, {"transfer.intervals.0.opacity": 3}) == "transfer.intervals.0.opacity"
    assert key(scene, {"camera.fov": 500}) == "camera.fov"
    wrong = {"materials": {"bone": {"reflectance": 0.5, "gloss": 1}}}
    error = pytest.raises(relume.SceneError, relume.Scene, wrong, volume=relume.Volume(ball)).value
    assert error.key == "materials.bone.gloss" and "scene:" not in str(error)


def test_errors_have_classes(scene, film, tmp_path):
    with pytest.raises(relume.VolumeError) as error:
        relume.open(tmp_path / "none.nrrd")
    assert error.value.code == "volume-not-openable"
    with pytest.raises(relume.DeviceError) as error:
        scene.render((8, 8), device="no such device")
    assert error.value.code == "device-unknown"
    with pytest.raises(relume.OutputError):
        film.to_exr(tmp_path / "none" / "film.exr")
    with pytest.raises(relume.OutputError):
        relume.Film.from_exr(b"no film")
    with pytest.raises(relume.PaletteError):
        relume.Palette({"materials": 3})
    with pytest.raises(relume.UnknownNameError) as error:
        film.relight("D66")
    assert isinstance(error.value, KeyError) and str(error.value).startswith("D66: there is no light")
    for wrong in ({"light": "D66"}, {"preset": "none"}, {"light": [("A", 1.0, "nowhere")]}):
        with pytest.raises(KeyError):
            film.relight(**wrong)
    for wrong in ({"hand": (numpy.nan, 0)}, {"exposure": 0}, {"light": {"A": -1}}):
        with pytest.raises(ValueError):
            film.relight(**wrong)
    for size in ((0, 5), (5, 0), (100_000, 5), (-3, 5), 300, (1, 2, 3), (3.5, 4), "big", None.__class__):
        with pytest.raises(ValueError, match="size"):
            scene.render(size)
    with pytest.raises(TypeError):
        film.relight("A", hand=(0, 0))
    with pytest.raises(TypeError, match="'spacing'"):
        relume.Volume(numpy.zeros((2, 2, 2)), spacng=1)
    with pytest.raises(relume.DeviceError, match='"cpu"'):
        scene.render((8, 8), device="cuda:0")
    assert scene.render([8, 8], device="CPU").size == (8, 8)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"transfer.intervals.0.range": [5000, 6000], "transfer.intervals.1.range": [5000, 6000]}, "is visible"),
        ({"lights.day.intensity": 0, "lights.lamp.intensity": 0}, "no light shines"),
        ({"lights.day.spectrum": {"samples": [-1.0] + [1.0] * 80}}, "negative"),
    ],
)
@pytest.mark.parametrize("device", ["auto", "cpu", "reference"])
def test_oddities_are_warnings(scene, change, sentence, device):
    with pytest.warns(relume.RelumeWarning, match=sentence):
        scene.define(change).render((16, 16), device=device)


def test_what_holds_itself_is_refused(scene, film):
    endless = {}
    endless["materials"] = endless
    turning = []
    turning.append(turning)
    deep = [0.0]
    for _ in range(100_000):
        deep = [deep]
    for wrong in (endless, {"lights": turning}, {"lights": deep}):
        with pytest.raises(ValueError, match="deeper"):
            relume.Scene(wrong, scene.volume)
        with pytest.raises(ValueError, match="deeper"):
            scene.define(wrong)
    with pytest.raises((relume.SpectrumError, ValueError)):
        film.relight(turning)


def test_values_that_are_none_are_warnings(ball):
    values = ball.astype("f4")
    values[0, 0, 0] = numpy.nan
    with pytest.warns(relume.RelumeWarning, match="1 voxels are NaN"):
        relume.Scene.first_look(relume.Volume(values)).render((16, 16))


def test_good_scenes_have_no_warnings(scene):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.render((32, 32)).relight("A")


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.binary(max_size=4),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=6,
)
KEYS = st.sampled_from(
    ["materials", "transfer", "lights", "camera", "display", "accuracy", "volume", "labels", "crop", "dial", "shadows"]
)
MANY = {"max_examples": 2500, "deadline": None, "suppress_health_check": list(HealthCheck)}


@settings(**MANY)
@given(st.dictionaries(KEYS | st.text(max_size=5), VALUES, max_size=4))
def test_any_dict_is_a_scene_or_an_error(description):
    volume = relume.Volume(numpy.zeros((2, 2, 2), "u1"))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            relume.Scene(description, volume=volume)
        except (relume.RelumeError, TypeError, ValueError):
            pass


@settings(**MANY)
@given(st.sampled_from(["camera.", "lights.day.", "materials.bone.", "accuracy.", ""]), st.text(max_size=8), VALUES)
def test_any_definition_is_a_scene_or_an_error(scene, table, name, value):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            scene.define({table + name: value})
        except (relume.RelumeError, TypeError, ValueError):
            pass


@settings(**MANY)
@given(VALUES, st.none() | st.tuples(st.floats(), st.floats()), VALUES)
def test_any_light_is_a_picture_or_an_error(film, light, hand, exposure):
    try:
        film.relight(light, hand=hand, exposure=exposure)
    except (relume.RelumeError, TypeError, ValueError, KeyError, OverflowError):
        pass


@settings(**MANY)
@given(
    st.sampled_from("?bhilqefdFDgcMO"),
    st.lists(st.integers(0, 4), max_size=5),
    st.none() | st.lists(st.floats(), max_size=4),
    st.none() | st.lists(st.floats(), min_size=9, max_size=9),
)
def test_any_array_is_a_volume_or_an_error(kind, shape, spacing, direction):
    array = numpy.zeros(shape, kind)
    turned = None if direction is None else numpy.reshape(direction, (3, 3))
    try:
        relume.Volume(array, spacing=spacing, direction=turned)
    except (relume.VolumeError, TypeError):
        pass
