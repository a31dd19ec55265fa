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
    "UnknownNameError",
    "Volume",
    "VolumeError",
    "__version__",
    "devices",
    "example",
    "open",
    "release",
    "spectrum",
    "standards",
    "xyz",
]

