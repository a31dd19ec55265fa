"""Films, pictures, pages and palettes of the module equal those of the command, to the byte."""

import pathlib
import struct
import zlib

import numpy
import pytest
from conftest import ROOT, command

import relume

SCENES = [path for path in sorted((ROOT / "data" / "scenes").glob("*.toml")) if "phantom" in path.read_text()]
SIZE = ["--size", "64x48"]


def png_codes(path):
    """The codes of an 8-bit RGB PNG."""
    data = pathlib.Path(path).read_bytes()
    width, height = struct.unpack(">II", data[16:24])
    packed, at = b"", 8
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at : at + 8])
        if kind == b"IDAT":
            packed += data[at + 8 : at + 8 + length]
        at += 12 + length
    rows = numpy.frombuffer(zlib.decompress(packed), numpy.uint8).reshape(height, 1 + 3 * width)
    picture = numpy.zeros((height + 1, 3 * width + 3), numpy.int64)
    for y, row in enumerate(rows):
        kind, line = row[0], row[1:].astype(numpy.int64)
        for x in range(3 * width):
            left, up, corner = picture[y + 1, x], picture[y, x + 3], picture[y, x]
            if kind == 4:
                guess = left + up - corner
                near = [abs(guess - one) for one in (left, up, corner)]
                add = (left, up, corner)[near.index(min(near))]
            else:
                add = (0, left, up, (left + up) // 2)[kind]
            picture[y + 1, x + 3] = (line[x] + add) % 256
    return picture[1:, 3:].reshape(height, width, 3)


@pytest.fixture(scope="module")
def built_in(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built-in")
    film = folder / "film.exr"
    command("render", "--accumulators", film, *SIZE)
    return film, relume.example().render((64, 48))


def test_a_film_is_that_of_the_command(built_in, tmp_path):
    path, film = built_in
    assert film.to_bytes() == path.read_bytes()
    film.to_exr(tmp_path / "same.exr")
    assert (tmp_path / "same.exr").read_bytes() == path.read_bytes()
    assert relume.Film.from_exr(path) == film == relume.Film.from_exr(path.read_bytes())


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_films_of_scenes_are_those_of_the_command(tmp_path, path):
    command("render", path, "--accumulators", tmp_path / "film.exr", *SIZE)
    assert relume.Scene.load(path).render((64, 48)).to_bytes() == (tmp_path / "film.exr").read_bytes()


@pytest.mark.parametrize("model", ["nodes", "sharpened"])
def test_films_of_colour_models_are_those_of_the_command(tmp_path, model):
    path = tmp_path / "film.exr"
    command("render", "--accumulate", "spectral", "--model", model, "--k", "5", "--accumulators", path, *SIZE)
    keys = {"accuracy.accumulate": "spectral", "accuracy.model": model, "accuracy.k": 5}
    film = relume.example().define(keys).render((64, 48))
    assert film.to_bytes() == path.read_bytes()
    assert film.model is not None


@pytest.mark.parametrize(
    ("flags", "asked"),
    [
        ([], {}),
        (["--light", "A"], {"light": "A"}),
        (["--light", "FL11=0.7", "--light", "D65=0.2"], {"light": {"FL11": 0.7, "D65": 0.2}}),
        (["--light", "blackbody 3000"], {"light": "blackbody 3000"}),
        (["--dial", "0.3,-0.2"], {"hand": (0.3, -0.2)}),
        (["--exposure", "1.5"], {"exposure": 1.5}),
        (["--observer", "1964", "--light", "A"], {"observer": 1964, "light": "A"}),
    ],
)
def test_pictures_are_those_of_the_command(built_in, tmp_path, flags, asked):
    path, film = built_in
    command("relight", path, *flags, "-o", tmp_path / "x.png")
    assert numpy.array_equal(film.relight(encoded=True, **asked), png_codes(tmp_path / "x.png"))
    film.to_png(tmp_path / "y.png", **asked)
    assert (tmp_path / "y.png").read_bytes() == (tmp_path / "x.png").read_bytes()


def test_pages_are_those_of_the_command(built_in, tmp_path):
    path, film = built_in
    command("page", path, "-o", tmp_path / "x.html")
    film.page(tmp_path / "y.html")
    assert (tmp_path / "y.html").read_bytes() == (tmp_path / "x.html").read_bytes()
    assert film.html() == (tmp_path / "x.html").read_text(encoding="utf-8")
    with pytest.raises(relume.OutputError, match="must end in .html"):
        film.page(tmp_path / "y.png")


def test_a_first_look_at_a_file_is_that_of_the_command(ball, tmp_path):
    header = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 16 20 24\nendian: little\nencoding: raw\n\n"
    path = tmp_path / "ball.nrrd"
    path.write_bytes(header.encode() + ball.astype("<u2").tobytes())
    command("render", path, "--accumulators", tmp_path / "film.exr", *SIZE)
    scene = relume.open(path)
    assert scene.render((64, 48)).to_bytes() == (tmp_path / "film.exr").read_bytes()
    assert "no scene" in scene.guess
    bone = relume.Scene.first_look(path, look="bone")
    assert bone != scene


def test_a_palette_is_that_of_the_command(tmp_path):
    text = """version = 1
[lights.day]
spectrum = "D65"
[lights.lamp]
spectrum = "A"
[materials.a]
[materials.b]
[cells.a]
day = "#808080"
[cells.b]
day = "as a"
"""
    (tmp_path / "palette.toml").write_text(text)
    palette = relume.Palette(text)
    command("design", tmp_path / "palette.toml", "-o", tmp_path / "solved.toml")
    solved = relume.Palette.load(tmp_path / "palette.toml").solve()
    assert solved.toml == (tmp_path / "solved.toml").read_text(encoding="utf-8")
    assert palette.solve().worst == solved.worst < 1e-3
    again = palette.solve(start=solved)
    assert again.worst <= solved.worst + 1e-9
    assert set(solved.materials) == {"a", "b"} and solved.materials["a"].shape == (81,)
