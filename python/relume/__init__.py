"""Spectral volume rendering with post-illumination.

A scene is marched once; the film is relit by any light, spectrum or mix of lights, without a march::

    import relume
    film = relume.open("scan.nii.gz").render()      # a first look made from the values
    film                                            # a picture in a notebook
    film.relight("A")                               # linear RGBA under another light
    film.page("scan.html")                          # a page that relights in a browser

Arrays, images of SimpleITK, ITK, nibabel, xarray, VTK and PyVista become a `Volume`. Scenes are dicts with the keys of
SCENE.md. Nothing but `render` needs Vulkan, and `device="cpu"` renders without it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ._errors import (
    Cancelled,
    DeviceError,
    DeviceMemoryError,
    OutputError,
    PaletteError,
    RelumeError,
    RelumeWarning,
    SceneError,
    SpectrumError,
    UnknownNameError,
    VolumeError,
)
from ._notebook import Turntable, turntable
from ._relume import (
    WAVELENGTHS,
    Film,
    Palette,
    Scene,
    Solution,
    Volume,
    __version__,
    devices,
    example,
    open,
    release,
    spectrum,
    standards,
    xyz,
)

WAVELENGTHS.flags.writeable = False

_NO_WIDGET = 'the widget needs anywidget: pip install "relume[widget]"; a page of a film needs nothing'


def view(
    scene: Scene,
    size: Sequence[int] = (400, 400),
    *,
    device: str | int | None = None,
    title: str | None = None,
    tolerance: float | None = None,
) -> Any:
    """The scene as a live widget of a notebook, which needs `anywidget` (`pip install "relume[widget]"`).

    The light changes in the browser, at its frame rate; a drag turns the camera by marches in Python. `widget.scene` and
    `widget.film` are the scene as it is turned and its film; `widget.light` is the light as it is shown, for `film.relight`.
    `device`, `title` and `tolerance` are those of `Scene.render` and `Film.page`.
    """
    try:
        from ._view import View
    except ImportError as error:
        raise ImportError(_NO_WIDGET) from error
    return View(scene, size, device=device, title=title, tolerance=tolerance)


def live(
    scene: Scene,
    size: Sequence[int] = (400, 400),
    *,
    device: str | int | None = None,
    title: str | None = None,
    tolerance: float | None = None,
    always: bool = False,
    progress: Callable[[str, int, int], object] | None = None,
) -> Any:
    """The scene as a widget whose browser marches the volume by WebGPU: Python does nothing while it is turned, cut and relit.

    The browser gets the voxels. `widget.camera`, `widget.crop` and `widget.densities` are what it shows, in both directions: set
    them, observe them, or link them between widgets (`traitlets.link`, `ipywidgets.jslink`). `widget.scene` is the scene as it is
    turned and cut, `widget.light` the light, and `widget.page(path)` writes a file. A browser without WebGPU, or whose device is too
    slow without `always`, shows the first view, and says so: `relume.view` marches in Python. Needs `anywidget`, and a Vulkan
    device for the first view.
    """
    try:
        from ._live import Live
    except ImportError as error:
        raise ImportError(_NO_WIDGET) from error
    return Live(scene, size, device=device, title=title, tolerance=tolerance, always=always, progress=progress)


__all__ = [
    "WAVELENGTHS",
    "Cancelled",
    "DeviceError",
    "DeviceMemoryError",
    "Film",
    "OutputError",
    "Palette",
    "PaletteError",
    "RelumeError",
    "RelumeWarning",
    "Scene",
    "SceneError",
    "Solution",
    "SpectrumError",
    "Turntable",
    "UnknownNameError",
    "Volume",
    "VolumeError",
    "__version__",
    "devices",
    "example",
    "live",
    "open",
    "release",
    "spectrum",
    "standards",
    "turntable",
    "view",
    "xyz",
]

