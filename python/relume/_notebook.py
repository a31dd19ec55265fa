"""What notebooks show: a page in a frame, and a turntable."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from ._relume import Film, Scene, _apng, _page_of


class Frame:
    """HTML for front ends with frames, and a PNG for the others."""

    def __init__(self, html: str, png: bytes) -> None:
        self._html = html
        self._png = png

    def __repr__(self) -> str:
        return "<a page of Relume in a frame, shown in notebooks>"

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, str]:
        import base64

        return {
            "text/html": self._html,
            "image/png": base64.b64encode(self._png).decode(),
            "text/plain": repr(self),
        }


class Turntable:
    """Films of a scene from all sides, `columns` in a row; rows are from the top."""

    def __init__(self, films: Iterable[Film], columns: int | None = None) -> None:
        self.films = list(films)
        self.columns = columns or len(self.films)
        if not self.films or len(self.films) % self.columns:
            raise ValueError(f"{len(self.films)} films are no rows of {self.columns}")

    @property
    def _middle(self) -> list[Film]:
        """The row in the middle, whose first film is that with which a page opens."""
        first = len(self.films) // self.columns // 2 * self.columns
        return self.films[first : first + self.columns]

    def _repr_png_(self) -> bytes:
        return self._middle[0]._repr_png_()

    def __repr__(self) -> str:
        return f"<relume.Turntable of {len(self.films)} films, {self.columns} in a row>"

    def html(
        self,
        title: str | None = None,
        tolerance: float | None = None,
        *,
        progress: Callable[[str, int, int], object] | None = None,
    ) -> str:
        """A page that turns and relights in a browser, as HTML text."""
        return _page_of(self.films, self.columns, title, tolerance, progress=progress)[0]

    def page(
        self,
        path: str | os.PathLike[str],
        title: str | None = None,
        tolerance: float | None = None,
        *,
        progress: Callable[[str, int, int], object] | None = None,
    ) -> None:
        """Writes the page as a file."""
        _page_of(self.films, self.columns, title, tolerance, path=path, progress=progress)

    def frame(self, title: str | None = None, tolerance: float | None = None, *, height: int = 760) -> Frame:
        """The page in a frame of a notebook."""
        _, framed = _page_of(self.films, self.columns, title, tolerance, height)
        return Frame(framed, self._repr_png_())

    def apng(
        self, path: str | os.PathLike[str], light: Any = None, *, per_second: int = 15, **display: Any
    ) -> None:
        """Writes the middle row as an animated PNG under a light; `display` is that of `Film.relight`."""
        _apng(path, [film.relight(light, **display) for film in self._middle], per_second)


def turntable(
    scene: Scene,
    views: int = 36,
    size: Sequence[int] = (400, 400),
    *,
    elevations: int = 1,
    device: str | int | None = None,
    progress: Callable[[str, int, int], object] | None = None,
) -> Turntable:
    """Marches a scene from `views` sides in each of `elevations` rows, 25 degrees apart.

    `progress(stage, done, total)` counts the views, and may cancel by returning False.
    """
    if views < 1 or elevations < 1:
        raise ValueError(f"{views} views in {elevations} rows: both are at least 1")
    return Turntable(scene._around(views, elevations, size, device, progress), views)
