"""Progress, Ctrl-C, threads, forks, pickles, and machines without Vulkan."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings

import numpy
import pytest

import relume


@pytest.fixture(scope="module")
def long(scene):
    """A march of many seconds."""
    return scene.define({"accuracy.step": 0.05, "accuracy.rays": 4})


def test_ctrl_c_ends_a_march(long, scene):
    ended = []

    def interrupt():
        time.sleep(0.3)
        ended.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt).start()
    with pytest.raises(KeyboardInterrupt):
        long.render((1500, 1500), device="cpu")
    assert time.perf_counter() - ended[0] < 1.0
    assert scene.render((64, 48)) == scene.render((64, 48))


def test_warnings_are_those_of_the_work_of_a_thread(scene):
    dark = scene.define({"lights.day.intensity": 0, "lights.lamp.intensity": 0})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        dark.render((16, 16))
    assert len(caught) == 1 and caught[0].filename == __file__
    with warnings.catch_warnings(), pytest.raises(relume.RelumeWarning):
        warnings.simplefilter("error")
        dark.render((16, 16))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene.render((16, 16))


def test_progress_is_told_and_may_cancel(long):
    stages = []
    with pytest.raises(relume.Cancelled) as cancelled:
        long.render((1500, 1500), progress=lambda *stage: stages.append(stage) or False)
    assert cancelled.value.code == "cancelled" and len(stages) == 1
    # One that is asked when the work is done cancels too.
    with pytest.raises(relume.Cancelled):
        long.define({"accuracy.step": 1, "accuracy.rays": 1}).render((8, 8), progress=lambda *_: False)
    stage, done, total = stages[0]
    assert isinstance(stage, str) and 0 <= done <= total

    def fails(*_):
        raise ZeroDivisionError("of the callback")

    with pytest.raises(ZeroDivisionError):
        long.render((1500, 1500), progress=fails)


def test_threads_make_what_one_makes(scene):
    turned = scene.define({"camera.azimuth": 40})
    expected = [scene.render((128, 96)), turned.render((128, 96))]
    lit = expected[0].relight("A")
    found = {}

    def work(i):
        if i < 2:
            found[i] = (scene, turned)[i].render((128, 96)) == expected[i]
        else:
            found[i] = all(numpy.array_equal(expected[0].relight("A"), lit) for _ in range(20))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == dict.fromkeys(range(6), True)


def test_other_threads_go_on(long):
    counted = [0]
    stop = threading.Event()

    def count():
        while not stop.wait(0.01):
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    start = time.perf_counter()
    long.render((48, 32), device="cpu")
    elapsed = time.perf_counter() - start
    stop.set()
    thread.join()
    assert counted[0] > 20 * elapsed, f"{counted[0]} in {elapsed} s"


def test_the_volume_of_another_camera_is_not_uploaded_again(ball):
    scene = relume.Scene.first_look(relume.Volume(ball))
    scene.render((32, 32))
    uploads = relume._relume._uploads("auto")
    for azimuth in (10, 20, 30):
        scene.define({"camera.azimuth": azimuth}).render((32, 32))
    lit = scene.define({"display.exposure": 2})
    lit.render((32, 32))
    assert relume._relume._uploads("auto") == uploads
    relume.Scene.first_look(relume.Volume(ball + 1)).render((32, 32))
    assert relume._relume._uploads("auto") == uploads + 1
    relume.release()
    scene.render((32, 32))
    assert relume._relume._uploads("auto") == 1


def test_the_cpu_makes_the_film_of_a_device(scene, film):
    on_cpu = scene.render((96, 64), device="cpu")
    assert abs(on_cpu.weights - film.weights).max() < 1e-3
    assert abs(on_cpu.relight() - film.relight()).mean() < 1e-5
    truth = scene.render((24, 16), device="reference")
    assert abs(truth.weights - scene.render((24, 16)).weights).mean() < 1e-3


def test_objects_are_pickled(scene, film):
    for made in (scene, film, scene.volume):
        same = pickle.loads(pickle.dumps(made))
        assert same == made and hash(same) == hash(made)
    error = pytest.raises(relume.SceneError, scene.define, {"camera.fov": 500}).value
    same = pickle.loads(pickle.dumps(error))
    assert (str(same), same.code, same.key) == (str(error), error.code, "camera.fov")


def in_child(scene, film, answers):
    try:
        scene.render((16, 16))
        answers.put("rendered")
    except relume.DeviceError as error:
        lit = film.relight("A").mean()
        answers.put((error.code, float(lit), scene.render((16, 16), device="cpu").size))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no forks here")
def test_a_child_of_a_process_with_a_device_is_told(scene, film):
    scene.render((16, 16))
    context = multiprocessing.get_context("fork")
    answers = context.Queue()
    child = context.Process(target=in_child, args=(scene, film, answers))
    child.start()
    code, lit, size = answers.get(timeout=60)
    child.join()
    assert code == "device-forked" and lit == pytest.approx(film.relight("A").mean()) and size == (16, 16)


WITHOUT = """
import numpy, relume
scene = relume.Scene.first_look(relume.Volume(numpy.arange(4096, dtype="u2").reshape(16, 16, 16)))
try:
    scene.render((32, 32))
except relume.DeviceError as error:
    assert "mesa-vulkan-drivers" in str(error) and 'device="cpu"' in str(error), error
else:
    raise SystemExit("rendered")
film = scene.render((32, 32), device="cpu")
film.relight("A"), film.html(), film.to_bytes(), film._repr_png_(), scene._repr_png_()
"""


def test_nothing_but_a_render_needs_vulkan():
    hidden = {**os.environ, "VK_DRIVER_FILES": "/none", "VK_ICD_FILENAMES": "/none"}
    subprocess.run([sys.executable, "-W", "error", "-c", WITHOUT], check=True, env=hidden)


def test_an_import_takes_no_time_over_numpy():
    code = "import numpy, time; start = time.perf_counter(); import relume; print(time.perf_counter() - start)"
    times = [float(subprocess.run([sys.executable, "-c", code], check=True, capture_output=True).stdout) for _ in range(5)]
    assert min(times) < 0.030, times
