"""Exposure, tone and quality: what happens between linear light and the screen, and how much of it a picture has."""

import numpy
import pytest

import relume

SIZE = (24, 24)


@pytest.fixture(scope="module")
def ball():
    z, y, x = numpy.mgrid[:24, :24, :24] - 11.5
    radius = numpy.sqrt(x**2 + y**2 + z**2)
    noise = numpy.arange(24**3).reshape(24, 24, 24) % 7
    return (numpy.where(radius < 8, 160, 0) + noise).astype(numpy.uint8)


def test_an_automatic_exposure_makes_the_brighter_parts_almost_white(ball):
    film = relume.Scene.first_look(ball).render(SIZE, device="cpu")
    picture = film.relight(exposure="auto")
    luminance = (picture[..., :3] @ [0.2126, 0.7152, 0.0722])[picture[..., 3] > 0.9]
    assert 0.5 < numpy.percentile(luminance, 97) < 0.8
    # Linear in the factor, and soft in the codes alone.
    assert numpy.allclose(film.relight(exposure=2)[..., :3], 2 * film.relight(exposure=1)[..., :3], rtol=1e-5)
    soft, clipped = (film.relight(exposure=9, tone=tone, encoded=True) for tone in ("soft", "linear"))
    assert (clipped == 255).all(axis=2).any() and not (soft == 255).all(axis=2).any()
    with pytest.raises(TypeError, match="encoded"):
        film.relight(tone="soft")
    with pytest.raises(ValueError, match="linear"):
        film.relight(tone="hard", encoded=True)
    with pytest.raises(ValueError, match="auto"):
        film.relight(exposure="bright")


def test_a_quality_is_one_word(ball):
    draft, best = (relume.Scene.first_look(ball).define(quality=quality) for quality in ("draft", "best"))
    rough, fine = (scene.render(SIZE, device="cpu").relight(exposure=1) for scene in (draft, best))
    assert not numpy.allclose(rough, fine)
    assert fine[..., :3].mean() < rough[..., :3].mean(), "shadows and the sky darken"
    again = relume.Scene.first_look(ball).define({"accuracy.rays": 1}, quality="best")
    assert "rays = 1" in again.toml
    with pytest.raises(ValueError, match="good"):
        relume.Scene.first_look(ball).define(quality="goood")
