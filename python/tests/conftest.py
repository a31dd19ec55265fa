"""Scenes and volumes of the tests, and the command."""

import os
import pathlib
import subprocess

import numpy
import pytest

import relume

COMMAND = os.environ["RELUME_COMMAND"]
ROOT = pathlib.Path(os.environ["RELUME_ROOT"])


def command(*arguments, **options):
    """Runs the command `relume`; returns what it prints."""
    done = subprocess.run([COMMAND, *map(str, arguments)], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def ball():
    """Values of a ball, from 1000 in its middle, (z, y, x)."""
    z, y, x = numpy.mgrid[-1:1:24j, -1:1:20j, -1:1:16j]
    return (1000 - 900 * numpy.sqrt(x * x + y * y + z * z)).clip(0).astype(numpy.uint16)


DESCRIPTION = {
    "materials": {"bone": {"reflectance": "white 9.5"}, "skin": {"reflectance": numpy.linspace(0.2, 0.8, 81)}},
    "transfer": {
        "intervals": [
            {"material": "bone", "range": [500, 1500], "opacity": 0.5},
            {"material": "skin", "range": [200, 500], "opacity": 0.1},
        ]
    },
    "lights": {
        "day": {"spectrum": "D65", "kind": "directional", "direction": [-1, -1, -1]},
        "lamp": {"spectrum": "A", "kind": "headlight", "intensity": 0.5},
    },
}


@pytest.fixture(scope="session")
def scene(ball):
    return relume.Scene(DESCRIPTION, volume=relume.Volume(ball, spacing=(1, 1, 1.2), unit="mm"))


@pytest.fixture(scope="session")
def film(scene):
    return scene.render((96, 64))
