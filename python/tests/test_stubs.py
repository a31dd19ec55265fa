"""The types that editors and mypy see are those of the module."""

import subprocess
import sys

USE = """
import numpy
import relume

volume = relume.Volume(numpy.zeros((4, 4, 4)), spacing=(1, 1, 2), unit="mm")
scene = relume.Scene.first_look(volume).define({"camera.azimuth": 40})
film = scene.render((64, 48), device="cpu", progress=lambda stage, done, total: print(stage))
picture = film.relight({"A": 0.5}, exposure=2.0)
print(picture.mean(), film.weights.shape, relume.spectrum("D65").sum())
relume.turntable(scene.moved(orbit=(10, 0)), 4, (32, 32)).page("turn.html")
widget = relume.view(scene, title="a volume")
live = relume.live(scene.turned(azimuth=40, zoom=2), (320, 240), always=True)
"""


def run(folder, *arguments):
    done = subprocess.run([sys.executable, "-m", *arguments], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_stubs_are_those_of_the_module(tmp_path):
    # Their metaclass is that of traitlets, which has no types.
    (tmp_path / "allowed").write_text("relume._view.View\nrelume._view.Lit\nrelume._live.Live\n")
    run(tmp_path, "mypy.stubtest", "relume", "--ignore-missing-stub", "--allowlist", "allowed")


def test_a_program_has_types(tmp_path):
    (tmp_path / "use.py").write_text(USE)
    run(tmp_path, "mypy", "--strict", "use.py")
