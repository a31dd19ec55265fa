"""The widget whose browser marches the volume: light, camera, cuts and densities without Python."""

import copy
import json
import math
import numbers
import pathlib
import warnings

import traitlets

from ._errors import RelumeWarning
from ._relume import Scene
from ._view import Lit, checked_size

# What turns a camera, as `Scene.turned` takes it.
_CAMERA = ("azimuth", "elevation", "zoom", "pan")


# Ranges of what the browser shows.
_RANGES = {"elevation": (-89.9, 89.9), "zoom": (0.3, 30.0), "pan": (-5.0, 5.0)}


def _number(name, value, low=-math.inf, high=math.inf):
    if not isinstance(value, numbers.Real) or isinstance(value, bool) or not math.isfinite(value):
        raise traitlets.TraitError(f"{name} {value!r} is not a finite number")
    if not low <= value <= high:
        raise traitlets.TraitError(f"{name} {value:g}: from {low:g} to {high:g}")
    return float(value)


def _numbers(name, values, count=None):
    """`values`, as of an array, as a list of so many."""
    try:
        found = list(values)
    except TypeError:
        raise traitlets.TraitError(f"{name} {values!r} is no list of numbers") from None
    if count is not None and len(found) != count:
        raise traitlets.TraitError(f"{name} {values!r}: {count} of them are needed")
    return found


class _Fixed(dict):
    """A value of a trait: a change in place would reach nobody."""

    def _refuse(self, *_arguments, **_named):
        raise TypeError("a value is assigned as a whole, and what it leaves out stays: widget.camera = {'azimuth': 40}")

    __setitem__ = __delitem__ = update = pop = popitem = clear = setdefault = _refuse
    __ior__ = _refuse


class Live(Lit):
    """A scene in a notebook, whose volume the browser marches. See `relume.live`."""

    _esm = (pathlib.Path(__file__).parent / "live.js").read_text(encoding="utf-8")
    _volume = traitlets.Unicode().tag(sync=True)
    _blocks = traitlets.Dict(value_trait=traitlets.Bytes()).tag(sync=True)
    always = traitlets.Bool(help="March in the browser even where that takes long").tag(sync=True)
    camera = traitlets.Dict(help="azimuth and elevation in degrees, zoom, and pan in picture heights").tag(sync=True)
    crop = traitlets.Any(help="Two opposite corners of what is shown, in voxel indices").tag(sync=True)
    densities = traitlets.Dict(help="Factors of the densities of materials, by name").tag(sync=True)

    def __init__(self, scene, size=(400, 400), *, device=None, title=None, tolerance=None, always=False, progress=None):
        if not isinstance(scene, Scene):
            raise TypeError(f"a scene is shown, not {type(scene).__name__}: relume.open(path or array)")
        self._size = checked_size(size)
        film, self._packed = scene._live(self._size, device=device, progress=progress)
        self._scene, self._film, self._title, self._tolerance = scene, film, title, tolerance
        page, view, _ = film._packed(title, tolerance)
        described = json.loads(self._packed.json)
        opened = described["camera"]
        self._block = described["block"]
        names = [component["name"] for component in json.loads(page).get("components", [])]
        self._whole = {
            "camera": {"azimuth": opened["azimuth"], "elevation": opened["elevation"], "zoom": 1.0, "pan": [0.0, 0.0]},
            "crop": [
                [(at + 0.5) * voxels - 0.5 for at, voxels in zip(corner, self._block)] for corner in described["crop"]
            ],
            "densities": {name: 1.0 for name, _ in zip(names, described["densities"])},
        }
        self._png = film._repr_png_()
        # Valid values of traits: what a new one leaves out stays.
        self._kept = copy.deepcopy(self._whole)
        super().__init__(
            _page=page,
            _views=[view],
            _volume=self._packed.json,
            _blocks=dict(self._packed.blocks),
            always=always,
            **copy.deepcopy(self._whole),
        )

    # ---- what Python sets ----

    def _named(self, what, value):
        """`value` with what it leaves out as it is, of the names that there are."""
        known = self._whole[what]
        wrong = [name for name in value if name not in known]
        if wrong:
            there = ", ".join(known) or "none: a colour model, absorption and extremes have none"
            raise traitlets.TraitError(f"{what} has no {wrong[0]!r}; there are: {there}")
        return {**self._kept[what], **value}

    @traitlets.validate("camera")
    def _camera_of(self, proposal):
        given = self._named("camera", proposal["value"])
        camera = {name: _number(name, given[name], *_RANGES.get(name, ())) for name in _CAMERA[:3]}
        camera["pan"] = [_number("pan", part, *_RANGES["pan"]) for part in _numbers("pan", given["pan"], 2)]
        self._kept["camera"] = camera
        return _Fixed(camera)

    @traitlets.validate("crop")
    def _crop_of(self, proposal):
        corners, whole = proposal["value"], self._whole["crop"]
        if corners is None or len(_numbers("crop", corners)) == 0:
            return copy.deepcopy(whole)
        corners = [[_number("crop", at) for at in _numbers("crop", corner, 3)] for corner in _numbers("crop", corners, 2)]
        # What is beyond the box of the scene is not in the browser.
        cut = [[min(max(at, low), high) for at, low, high in zip(corner, *whole)] for corner in corners]
        for low, high, first, last, block in zip(*cut, *whole, self._block):
            if high - low < min(block, last - first):
                raise traitlets.TraitError(f"crop {corners!r}: the lower corner first, a voxel apart or more, in {whole}")
        return cut

    @traitlets.validate("densities")
    def _densities_of(self, proposal):
        given = self._named("densities", proposal["value"])
        densities = {name: _number(f"the density of {name}", part, 0, 2) for name, part in given.items()}
        self._kept["densities"] = densities
        return _Fixed(densities)

    # ---- what Python gets ----

    @property
    def scene(self):
        """The scene as it is turned and cut, to be rendered; densities are the widget's alone."""
        scene = self._scene
        if self.densities != self._whole["densities"]:
            message = "densities are those of the browser alone: this scene has the materials as they were opened"
            warnings.warn(message, RelumeWarning, stacklevel=2)
        if self.crop != self._whole["crop"]:
            low, high = self.crop
            scene = scene.define({"crop": {"min": low, "max": high}})
        if self.camera != self._whole["camera"]:
            scene = scene.turned(**self.camera, size=self._size)
        return scene

    @property
    def film(self):
        """The film with which the widget opened."""
        return self._film

    def page(self, path, title=None, tolerance=None):
        """Writes a live page, whose reader turns the volume as it opened here, as a file."""
        self._film._live_page(path, self._packed, title or self._title, tolerance or self._tolerance)

    def __repr__(self):
        return f"<relume.live of {self._scene!r}>"
