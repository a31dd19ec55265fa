"""The compiled part of the package; `relume` has its public names."""

import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, final

import numpy
from numpy.typing import ArrayLike, NDArray

__version__: str
WAVELENGTHS: NDArray[numpy.float64]

_Path = str | os.PathLike[str]
_Progress = Callable[[str, int, int], object]
_Spectrum = Any
_Image = Any

@final
class Volume:
    def __new__(
        cls,
        image: _Image,
        *,
        spacing: float | Sequence[float] | None = None,
        origin: Sequence[float] | None = None,
        direction: ArrayLike | None = None,
        affine: ArrayLike | None = None,
        axes: str | None = None,
        unit: str | None = None,
        anatomical: bool | None = None,
        labels: bool | None = None,
        slope: float | None = None,
        intercept: float | None = None,
        source: str | None = None,
    ) -> Volume: ...
    @property
    def dims(self) -> tuple[int, int, int]: ...
    @property
    def shape(self) -> tuple[int, int, int]: ...
    @property
    def dtype(self) -> numpy.dtype[Any]: ...
    @property
    def spacing(self) -> tuple[float, float, float]: ...
    @property
    def origin(self) -> tuple[float, float, float]: ...
    @property
    def direction(self) -> NDArray[numpy.float64]: ...
    @property
    def affine(self) -> NDArray[numpy.float64]: ...
    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]: ...
    @property
    def unit(self) -> str | None: ...
    @property
    def slope(self) -> float: ...
    @property
    def intercept(self) -> float: ...
    @property
    def anatomical(self) -> bool: ...
    @property
    def source(self) -> str: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def array(self) -> NDArray[Any]: ...
    @property
    def range(self) -> tuple[float, float]: ...
    def world(self, index: Sequence[float]) -> tuple[float, float, float]: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class LiveVolume:
    @property
    def json(self) -> str: ...
    @property
    def blocks(self) -> list[tuple[str, bytes]]: ...

@final
class Scene:
    def __new__(
        cls,
        description: Mapping[str, Any] | str,
        volume: _Image | None = None,
        labels: _Image | None = None,
        *,
        base: _Path | None = None,
        name: str = "scene",
        define: Mapping[str, Any] | None = None,
    ) -> Scene: ...
    @classmethod
    def load(
        cls,
        path: _Path,
        volume: _Image | None = None,
        labels: _Image | None = None,
        *,
        define: Mapping[str, Any] | None = None,
        progress: _Progress | None = None,
    ) -> Scene: ...
    @classmethod
    def first_look(
        cls,
        volume: _Image,
        labels: _Image | None = None,
        *,
        look: str | None = None,
        preset: _Path | None = None,
        define: Mapping[str, Any] | None = None,
        progress: _Progress | None = None,
    ) -> Scene: ...
    def define(
        self,
        definitions: Mapping[str, Any] | None = None,
        *,
        quality: Literal["draft", "good", "best"] | None = None,
    ) -> Scene: ...
    def _around(
        self,
        columns: int,
        rows: int,
        size: Sequence[int] | None,
        device: str | int | None = None,
        progress: _Progress | None = None,
    ) -> list[Film]: ...
    def moved(
        self,
        *,
        orbit: Sequence[float] | None = None,
        pan: Sequence[float] | None = None,
        dolly: float | None = None,
        roll: float | None = None,
        size: Sequence[int] | None = None,
    ) -> Scene: ...
    def turned(
        self,
        *,
        azimuth: float | None = None,
        elevation: float | None = None,
        zoom: float = 1.0,
        pan: Sequence[float] = ...,
        size: Sequence[int] | None = None,
    ) -> Scene: ...
    def _live(
        self,
        size: Sequence[int] | None = None,
        *,
        device: str | int | None = None,
        progress: _Progress | None = None,
    ) -> tuple[Film, LiveVolume]: ...
    def view(self, size: Sequence[int] | None = None) -> dict[str, Any]: ...
    def render(
        self,
        size: Sequence[int] | None = None,
        *,
        device: str | int | None = None,
        lights: Mapping[str, _Spectrum] | None = None,
        max_error: float | None = None,
        budget_ms: float | None = None,
        progress: _Progress | None = None,
    ) -> Film: ...
    @property
    def volume(self) -> Volume: ...
    @property
    def labels(self) -> Volume | None: ...
    @property
    def toml(self) -> str: ...
    @property
    def guess(self) -> str | None: ...
    @property
    def materials(self) -> dict[str, NDArray[numpy.float64]]: ...
    @property
    def lights(self) -> dict[str, NDArray[numpy.float64]]: ...
    def explain(self) -> list[str]: ...
    def __reduce__(self) -> tuple[Any, ...]: ...
    def _repr_png_(self) -> bytes: ...

@final
class Film:
    @classmethod
    def from_exr(cls, file: _Path | bytes) -> Film: ...
    @property
    def size(self) -> tuple[int, int]: ...
    @property
    def weights(self) -> NDArray[numpy.float32]: ...
    @property
    def transmittance(self) -> NDArray[numpy.float32]: ...
    @property
    def positions(self) -> list[str]: ...
    @property
    def components(self) -> list[str]: ...
    @property
    def lights(self) -> dict[str, dict[str, Any]]: ...
    @property
    def materials(self) -> dict[str, NDArray[numpy.float64]]: ...
    @property
    def model(self) -> str | None: ...
    @property
    def choice(self) -> dict[str, Any] | None: ...
    @property
    def dial(self) -> dict[str, Any]: ...
    def relight(
        self,
        light: Any = None,
        *,
        hand: tuple[float, float] | None = None,
        preset: str | None = None,
        exposure: float | Literal["auto"] | None = None,
        tone: Literal["linear", "soft"] | None = None,
        observer: int | str | None = None,
        adapt: bool | None = None,
        encoded: bool = False,
        out: NDArray[numpy.float32] | None = None,
    ) -> NDArray[Any]: ...
    def matrices(
        self,
        light: Any = None,
        *,
        hand: tuple[float, float] | None = None,
        preset: str | None = None,
        exposure: float | Literal["auto"] | None = None,
        observer: int | str | None = None,
        adapt: bool | None = None,
    ) -> tuple[NDArray[numpy.float64], NDArray[numpy.float64]]: ...
    def spectra(
        self,
        light: Any = None,
        *,
        hand: tuple[float, float] | None = None,
        preset: str | None = None,
    ) -> NDArray[numpy.float32]: ...
    def to_exr(self, path: _Path) -> None: ...
    def to_bytes(self) -> bytes: ...
    def to_png(
        self,
        path: _Path,
        light: Any = None,
        *,
        hand: tuple[float, float] | None = None,
        preset: str | None = None,
        exposure: float | Literal["auto"] | None = None,
        tone: Literal["linear", "soft"] | None = None,
        observer: int | str | None = None,
        adapt: bool | None = None,
    ) -> None: ...
    def html(
        self, title: str | None = None, tolerance: float | None = None, *, progress: _Progress | None = None
    ) -> str: ...
    def page(
        self,
        path: _Path,
        title: str | None = None,
        tolerance: float | None = None,
        *,
        progress: _Progress | None = None,
    ) -> None: ...
    def _live_page(
        self, path: _Path, volume: LiveVolume, title: str | None = None, tolerance: float | None = None
    ) -> None: ...
    def _packed(
        self,
        title: str | None,
        tolerance: float | None = None,
        step: float | None = None,
        *,
        progress: _Progress | None = None,
    ) -> tuple[str, bytes, float]: ...
    def frame(self, title: str | None = None, tolerance: float | None = None, *, height: int = 760) -> Any: ...
    def _repr_png_(self) -> bytes: ...
    def __reduce__(self) -> tuple[Any, ...]: ...

@final
class Palette:
    def __new__(
        cls, description: Mapping[str, Any] | str, *, base: _Path | None = None, name: str = "palette"
    ) -> Palette: ...
    @staticmethod
    def load(path: _Path) -> Palette: ...
    def solve(self, start: Solution | None = None, *, progress: _Progress | None = None) -> Solution: ...

@final
class Solution:
    @property
    def materials(self) -> dict[str, NDArray[numpy.float64]]: ...
    @property
    def lights(self) -> dict[str, NDArray[numpy.float64]]: ...
    @property
    def difference(self) -> dict[tuple[str, str], float]: ...
    @property
    def worst(self) -> float: ...
    @property
    def conflicts(self) -> list[str]: ...
    @property
    def toml(self) -> str: ...
    def _repr_svg_(self) -> str: ...

def open(
    path: _Path | _Image,
    *,
    look: str | None = None,
    preset: _Path | None = None,
    define: Mapping[str, Any] | None = None,
    quality: Literal["draft", "good", "best"] | None = None,
    progress: _Progress | None = None,
) -> Scene: ...
def example() -> Scene: ...
def spectrum(spectrum: _Spectrum, kind: str | None = None) -> NDArray[numpy.float64]: ...
def xyz(
    reflectance: _Spectrum, light: _Spectrum, observer: int | str | None = None
) -> NDArray[numpy.float64]: ...
def standards() -> dict[str, list[str]]: ...
def devices() -> list[dict[str, Any]]: ...
def release() -> None: ...
def _uploads(device: str) -> int: ...
def _page_of(
    films: Sequence[Film],
    columns: int,
    title: str | None = None,
    tolerance: float | None = None,
    height: int = 760,
    *,
    path: _Path | None = None,
    progress: _Progress | None = None,
) -> tuple[str, str]: ...
def _apng(path: _Path, pictures: Sequence[NDArray[numpy.float32]], per_second: int) -> None: ...
def _command(arguments: Sequence[str]) -> int: ...
def _volume_of(state: dict[str, Any]) -> Volume: ...
def _scene_of(
    text: str, volume: _Image, labels: _Image | None, base: _Path, name: str, further: list[tuple[str, _Image]]
) -> Scene: ...
