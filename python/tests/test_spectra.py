"""A spectrum has the same samples in every form."""

import types

import colour
import numpy
import pytest
from conftest import DESCRIPTION

import relume

NM = relume.WAVELENGTHS


def test_wavelengths_are_those_of_the_files():
    assert NM.shape == (81,) and NM[0] == 380 and NM[-1] == 780 and not NM.flags.writeable


def test_all_forms_of_a_spectrum_are_one(ball):
    samples = numpy.linspace(0.1, 0.9, 81)
    volume = relume.Volume(ball)
    forms = [
        samples,
        list(samples),
        (NM, samples),
        {"samples": samples},
        {str(nm): value for nm, value in zip(NM, samples)},
        {nm: value for nm, value in zip(NM, samples)},
        types.SimpleNamespace(wavelengths=NM, values=samples),
        colour.SpectralDistribution(samples, NM),
    ]
    for form in forms:
        assert abs(relume.spectrum(form) - samples).max() < 1e-12, form
    assert (relume.spectrum(0.25) == 0.25).all()
    for form in forms:
        made = relume.Scene({**DESCRIPTION, "materials": {"bone": {"reflectance": form}, "skin": {"reflectance": 0.5}}}, volume)
        assert abs(made.materials["bone"] - samples).max() < 1e-12, form
        assert abs(made.define({"materials.skin.reflectance": form}).materials["skin"] - samples).max() < 1e-12, form
    wrong = {**DESCRIPTION, "materials": {"bone": {"reflectance": samples[:80]}}}
    with pytest.raises(relume.SpectrumError, match="materials.bone.reflectance: 80 samples") as error:
        relume.Scene(wrong, volume)
    assert error.value.key == "materials.bone.reflectance"


def test_names_are_those_of_the_standards():
    names = relume.standards()
    assert "D65" in names["lights"] and "white 9.5" in names["reflectances"]
    assert abs(relume.spectrum("white 9.5")[10:] - 0.88).max() < 0.1
    assert numpy.array_equal(relume.spectrum("D65"), relume.spectrum("D65", kind="light"))


def test_colours_are_those_of_colour_science():
    light = relume.spectrum("D65", kind="light")
    assert abs(relume.xyz(1.0, "D65")[1] - 1) < 1e-12
    shape = colour.SpectralShape(380, 780, 5)
    cmfs = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
    patch = relume.spectrum("dark skin")
    weights = cmfs.values * light[:, None]
    expected = (weights * patch[:, None]).sum(0) / weights[:, 1].sum()
    assert abs(relume.xyz("dark skin", "D65") - expected).max() < 2e-4
    assert relume.xyz(0.5, "D65", observer=1964)[1] == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize(
    ("spectrum", "sentence"),
    [
        (numpy.zeros(80), "80"),
        ((NM, numpy.zeros(80)), "81 wavelengths and 80"),
        ("nothing of the kind", "no standard spectrum"),
        (numpy.full(81, numpy.nan), "finite|NaN|nan"),
    ],
)
def test_what_is_no_spectrum_is_refused(spectrum, sentence):
    with pytest.raises(relume.SpectrumError, match=sentence):
        relume.spectrum(spectrum)


def test_arrays_light_films(film):
    lamp = relume.spectrum("A", kind="light")
    assert abs(film.relight(lamp) - film.relight("A")).max() < 1e-6
    assert abs(film.relight([(lamp, 1.0, "day")]) - film.relight([("A", 1.0, "day")])).max() < 1e-6
