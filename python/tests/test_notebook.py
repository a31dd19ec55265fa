"""What notebooks show: pictures, pages, turntables, the live widget; and the notebooks of the examples."""

import base64
import json
import re
import time

import numpy
import pytest
from conftest import ROOT

import relume


def test_a_moved_camera_is_that_of_the_window(scene):
    opened = scene.view((96, 64))
    turned = scene.moved(orbit=(0, 30), size=(96, 64))
    angle = numpy.degrees(numpy.arccos(numpy.dot(opened["forward"], turned.view((96, 64))["forward"])))
    assert angle == pytest.approx(30, abs=0.5)
    for vector in ("forward", "right", "up"):
        assert numpy.linalg.norm(turned.view()[vector]) == pytest.approx(1)
    # The text says so too, and what was not moved is as it was.
    again = relume.Scene(turned.toml, turned.volume)
    assert again.render((48, 32)) == turned.render((48, 32)) != scene.render((48, 32))
    assert scene.moved(dolly=2.0).moved(dolly=0.5).view()["position"] == pytest.approx(scene.view()["position"])
    with pytest.raises(ValueError, match="cannot move by NaN"):
        scene.moved(pan=(0.1, float("nan")))
    with pytest.raises(ValueError, match="dolly=0: .* above 0"):
        scene.moved(dolly=0.0)
    with pytest.raises(ValueError, match="orbit=30: two numbers"):
        scene.moved(orbit=30)


def test_spectra_have_the_colours_of_the_picture(film):
    spectra = film.spectra("A")
    assert spectra.shape == (64, 96, 81) and spectra.dtype == numpy.float32
    # The sum over wavelengths of what arrives is the picture (D65 white, sRGB).
    flat = relume.xyz(1.0, "E")
    matching = numpy.array([relume.xyz(numpy.eye(81)[band], "E") for band in range(81)])
    xyz = spectra.astype(float) @ matching / flat[1]
    to_srgb = numpy.linalg.inv(
        [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
    )
    expected = film.relight("A")[..., :3]
    scale = expected.max()
    assert numpy.abs(xyz @ to_srgb.T * (expected.sum() / (xyz @ to_srgb.T).sum()) - expected).max() < 0.01 * scale


def test_a_setting_within_an_error_is_chosen_by_measurement(ball):
    scene = relume.Scene.first_look(relume.Volume(ball))
    film = scene.render((64, 48), max_error=2.0)
    assert film.size == (64, 48)
    assert {"why", "setting", "expected", "untried"} <= set(film.choice) and film.choice["why"]
    assert scene.render((64, 48)).choice is None
    with pytest.raises(TypeError, match="give max_error or budget_ms"):
        scene.render((64, 48), max_error=1, budget_ms=1)
    with pytest.raises(ValueError, match="max_error -1"):
        scene.render((64, 48), max_error=-1)
    with pytest.raises(ValueError, match="for a Vulkan device"):
        scene.render((64, 48), budget_ms=10, device="cpu")


def test_a_turntable_is_a_page_and_an_animation(scene, tmp_path):
    stages = []
    turned = relume.turntable(scene, 6, (40, 32), elevations=2, progress=lambda *stage: stages.append(stage))
    assert len(turned.films) == 12 and turned.columns == 6 and stages[-1][1:] == (12, 12)
    assert turned.films[0] != turned.films[1] != turned.films[6]
    # Without a device it is the same turn, within rounding.
    alone = relume.turntable(scene, 6, (40, 32), elevations=2, device="cpu")
    for one, two in zip(turned.films, alone.films):
        assert numpy.abs(one.weights - two.weights).max() < 1e-4
    turned.page(tmp_path / "all.html", title="All sides")
    html = (tmp_path / "all.html").read_text()
    assert html == turned.html(title="All sides") and html.count('id="relume-view-') == 12
    turned.apng(tmp_path / "turn.apng", "A", per_second=5)
    assert b"acTL" in (tmp_path / "turn.apng").read_bytes()
    assert "iframe" in turned.frame()._repr_mimebundle_()["text/html"]
    with pytest.raises(relume.OutputError, match=r"\.html"):
        turned.page(tmp_path / "all.png")
    with pytest.raises(ValueError, match="12 films are no rows of 5"):
        relume.Turntable(turned.films, 5)
    with pytest.raises(ValueError, match="0 views in 1 rows"):
        relume.turntable(scene, 0)
    with pytest.raises(relume.Cancelled):
        relume.turntable(scene, 3, (8, 8), progress=lambda *_: False)


def test_arrays_are_opened_and_pictures_saved_by_name(ball, tmp_path):
    opened = relume.open(ball)
    assert opened.toml == relume.Scene.first_look(ball).toml and opened.guess
    film = relume.open(relume.Volume(ball, spacing=(1, 1, 2)), look="grey").render((24, 16))
    film.to_png(tmp_path / "a.png")
    assert (tmp_path / "a.png").read_bytes() == film._repr_png_()
    with pytest.raises(relume.OutputError, match=r"must end in \.png"):
        film.to_png(tmp_path / "a.jpg")
    with pytest.raises(relume.SceneError, match="an array of length 3") as wrong:
        opened.define({"camera.up": [0, 0, 1, 5]})
    assert wrong.value.key == "camera.up"


def pictures_of(widget):
    """Sizes and errors of the pictures that the browser gets."""
    found = []
    widget.observe(lambda change: found.append((json.loads(change["new"])["size"], json.loads(change["new"])["largest_error"])), "_page")
    return found


def until(condition):
    began = time.perf_counter()
    while not condition():
        assert time.perf_counter() - began < 60
        time.sleep(0.02)


def test_the_widget_marches_what_the_browser_moves(scene):
    widget = relume.view(scene, (120, 80))
    assert widget.film == scene.render((120, 80)) and widget.scene is scene
    found, opened = pictures_of(widget), scene.view((120, 80))["position"]
    widget._level = 2
    widget._heard(widget, {"moves": [["orbit", 20, 5], ["dolly", 1.1]]}, [])
    until(lambda: widget._worker is None and found)
    # A small picture at once, then the whole one, then the whole one with its own rounding.
    assert [size for size, _ in found] == [[60, 40], [120, 80], [120, 80]]
    assert [error is None for _, error in found] == [True, True, False]
    turned = scene.moved(orbit=(20, 5), size=(120, 80)).moved(dolly=1.1, size=(120, 80))
    assert widget.scene.view() == turned.view() and widget.film == turned.render((120, 80))
    widget._heard(widget, {"moves": [["reset"]]}, [])
    until(lambda: widget._worker is None and len(found) == 6)
    assert widget.scene.view((120, 80))["position"] == pytest.approx(opened)
    # Another scene takes its place, and movements start from it.
    other = scene.define({"camera.azimuth": 70})
    widget.scene = other
    until(lambda: widget._worker is None and len(found) > 6)
    assert widget.film == other.render((120, 80))
    # Errors are told where the mouse is, and the next movement is marched.
    told = []
    widget.send = told.append
    widget._heard(widget, {"moves": [["dolly", 0.0]]}, [])
    until(lambda: told)
    assert "dolly=0" in told[0]["error"]
    widget._heard(widget, {"moves": [["orbit", 1, 0]]}, [])
    until(lambda: len(told) > 1)
    assert told[1] == {"error": None}
    until(lambda: widget._worker is None)


def test_the_light_of_the_widget_relights_its_film(scene):
    widget = relume.view(scene, (48, 32))
    assert widget.light is None and repr(scene) in repr(widget), "no browser has shown it"
    assert numpy.array_equal(widget.film.relight(widget.light), widget.film.relight())
    lights = scene.lights
    widget._mix = [[lights["day"].tolist(), 0.5, "day"], [lights["lamp"].tolist(), 0.25, "lamp"]]
    expected = widget.film.relight([("day", 0.5), ("lamp", 0.5)])
    assert numpy.allclose(widget.film.relight(widget.light), expected, atol=1e-6)
    bundle = widget._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    assert base64.b64decode(data["image/png"]) == widget.film._repr_png_()
    assert "application/vnd.jupyter.widget-view+json" in data
    with pytest.raises(TypeError, match="a scene is shown, not Film"):
        relume.view(widget.film)
    with pytest.raises(ValueError, match="size 300: write"):
        relume.view(scene, 300)


def test_a_turned_camera_is_that_of_a_live_page(scene):
    opened, size = scene.view((96, 64)), (96, 64)
    again = scene.turned(size=size)
    assert again.render(size) == scene.render(size)
    # As a lens: the eye stays, and the picture is half as wide.
    near = scene.turned(zoom=2, size=size).view(size)
    assert near["position"] == pytest.approx(opened["position"]) and near["half"][1] == pytest.approx(opened["half"][1] / 2)
    moved = scene.turned(zoom=2, pan=(0.25, 0), size=size).view(size)
    across = numpy.dot(numpy.subtract(moved["position"], near["position"]), opened["right"])
    assert across > 0 and moved["forward"] == pytest.approx(near["forward"])
    other = scene.turned(azimuth=70, elevation=-10, size=size)
    assert other.view(size)["forward"] != pytest.approx(opened["forward"])
    with pytest.raises(ValueError, match="zoom=0"):
        scene.turned(zoom=0)
    with pytest.raises(ValueError, match="elevation=95: .* from -89.9 to 89.9"):
        scene.turned(elevation=95)
    with pytest.raises(ValueError, match="cannot turn by inf"):
        scene.turned(azimuth=float("inf"))


def test_the_live_widget_shares_what_it_shows(scene, tmp_path):
    import traitlets

    widget = relume.live(scene, (48, 32), title="A ball")
    assert widget.film == scene.render((48, 32)) and widget.scene is scene and repr(scene) in repr(widget)
    assert json.loads(widget._volume)["dims"] == list(reversed(scene.volume.array.shape)) and "shader" in widget._blocks
    assert widget.camera["zoom"] == 1 and widget.camera["pan"] == [0, 0]
    # What is set leaves the rest as it is, and another widget follows.
    widget.camera = {"azimuth": 70.0}
    widget.camera = {"zoom": 1.5}
    assert widget.camera == {**widget._whole["camera"], "azimuth": 70, "zoom": 1.5}
    other = relume.live(scene, (48, 32))
    link = traitlets.link((widget, "camera"), (other, "camera"))
    widget.camera = {"elevation": -5}
    assert other.camera["elevation"] == -5 and other.scene.view((48, 32)) == widget.scene.view((48, 32))
    link.unlink()
    # The scene is what the browser shows.
    assert widget.scene.view((48, 32)) == scene.turned(azimuth=70, elevation=-5, zoom=1.5, size=(48, 32)).view((48, 32))
    # Numbers of numpy are numbers, and what is beyond the volume is cut off.
    widget.crop = numpy.array([[2, 2, 2], [9, 20, 200]])
    assert widget.crop[0] == [2, 2, 2] and widget.crop[1][0] == 9
    assert "crop" in widget.scene.toml and widget.scene.render((48, 32)) != scene.render((48, 32))
    widget.crop = []
    assert widget.crop == widget._whole["crop"] and "crop" not in widget.scene.toml
    widget.crop[0][2] = 8
    widget.crop = []
    assert widget.crop[0][2] == 0, "nobody changes what is whole"
    with widget.hold_trait_notifications():
        widget.camera = {"zoom": 2}
    assert widget.camera == {"azimuth": 70, "elevation": -5, "zoom": 2, "pan": [0, 0]}
    name = next(iter(widget.densities))
    widget.densities = {name: 0.5}
    assert widget.densities[name] == 0.5
    with pytest.raises(TypeError, match="assigned as a whole"):
        widget.camera["azimuth"] = 3
    with pytest.warns(relume.RelumeWarning, match="densities are those of the browser"):
        assert widget.scene.toml
    for trait, value, why in [
        ("camera", {"azimut": 1}, "has no 'azimut'"),
        ("camera", {"azimuth": float("nan")}, "not a finite number"),
        ("camera", {"zoom": 100}, "zoom 100: from 0.3 to 30"),
        ("camera", {"elevation": 95}, "elevation 95: from -89.9 to 89.9"),
        ("camera", {"pan": 3}, "no list of numbers"),
        ("crop", [[1, 2, 3]], "2 of them"),
        ("crop", [1, 2], "no list of numbers"),
        ("crop", 3, "no list of numbers"),
        ("crop", [[1, 2, 3], [8, 2.5, 9]], "a voxel apart"),
        ("densities", {"nothing": 1}, "has no 'nothing'"),
        ("densities", {name: 3}, "from 0 to 2"),
    ]:
        before = getattr(widget, trait)
        with pytest.raises(traitlets.TraitError, match=why):
            setattr(widget, trait, value)
        assert getattr(widget, trait) == before
    widget.page(tmp_path / "ball.html")
    html = (tmp_path / "ball.html").read_text()
    assert "A ball" in html and 'id="relume-live-voxels-0"' in html
    with pytest.raises(relume.OutputError, match=r"\.html"):
        widget.page(tmp_path / "ball.png")
    with pytest.raises(ValueError, match="needs a Vulkan device"):
        relume.live(scene, device="cpu")
    with pytest.raises(relume.DeviceError) as wrong:
        relume.live(scene, device="no such device")
    assert "reference" not in str(wrong.value), "what a live widget cannot do"
    with pytest.raises(TypeError, match="a scene is shown, not Film"):
        relume.live(widget.film)
    with pytest.raises(ValueError, match="size 300: write"):
        relume.live(scene, 300)


@pytest.mark.parametrize("name", ["figure_1", "ct"])
def test_the_notebooks_of_the_examples_run(name, tmp_path):
    import nbclient
    import nbformat

    notebook = nbformat.read(ROOT / "python/examples" / f"{name}.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells), "notebooks are kept without outputs"
    for cell in notebook.cells:
        # A tenth of the pixels.
        cell.source = re.sub(r"\((\d\d)\d, (\d\d)\d", lambda size: f"({3 * int(size[1])}, {3 * int(size[2])}", cell.source)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    kinds = [kind for output in outputs for kind in output.get("data", {})]
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert kinds.count("image/png") >= 6 and "text/html" in kinds
    assert kinds.count("application/vnd.jupyter.widget-view+json") == 1
    # What is left without a kernel.
    live = next(output.data for output in outputs if "application/vnd.jupyter.widget-view+json" in output.get("data", {}))
    assert "image/png" in live
    page = next(output.data["text/html"] for output in outputs if "text/html" in output.get("data", {}))
    assert "<iframe" in page and (tmp_path / f"{name}.html").exists()
