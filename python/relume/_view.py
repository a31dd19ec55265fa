"""Widgets: light in the browser, and a camera by a march in Python."""

import base64
import contextlib
import pathlib
import threading
import time

import anywidget
import numpy
import traitlets

from ._errors import Cancelled
from ._relume import Film, Scene

# Seconds that a picture should take while the camera moves, and without a movement until the whole picture is marched.
_QUICK = 0.12
_STILL = 0.2
# Sides of pictures while the camera moves, in parts of the whole.
_SHARES = (1.0, 0.7, 0.5, 0.35, 0.25)


def checked_size(size):
    """(width, height) as whole numbers."""
    try:
        width, height = size
        return int(width), int(height)
    except (TypeError, ValueError):
        raise ValueError(f"size {size}: write (width, height)") from None


class Lit(anywidget.AnyWidget):
    """A picture that is lit in the browser; `_png` is the same for front ends without widgets."""

    _page = traitlets.Unicode().tag(sync=True)
    _views = traitlets.List(traitlets.Bytes()).tag(sync=True)
    _mix = traitlets.List(traitlets.Any()).tag(sync=True)
    hand = traitlets.List(traitlets.Float(), [0.0, 0.0], minlen=2, maxlen=2, help="Hand of the light dial").tag(sync=True)
    picked = traitlets.List(traitlets.Int(), help="Column and row of the picked pixel, or nothing").tag(sync=True)
    _png = b""

    @property
    def light(self):
        """The light as it is shown: (spectrum, weight, position) of each, for `film.relight`; `None` until a browser has shown it."""
        if not self._mix:
            return None
        return [(numpy.array(spectrum), weight, position) for spectrum, weight, position in self._mix]

    def _repr_mimebundle_(self, **options):
        # Front ends without widgets, and notebooks without a kernel, show the picture.
        bundle = super()._repr_mimebundle_(**options)
        data, *metadata = bundle if isinstance(bundle, tuple) else (bundle,)
        data = {**(data or {}), "image/png": base64.b64encode(self._png).decode()}
        return (data, *metadata) if metadata else data


class View(Lit):
    """A scene in a notebook. See `relume.view`."""

    _esm = (pathlib.Path(__file__).parent / "widget.js").read_text(encoding="utf-8")
    scene = traitlets.Instance(Scene, help="The scene as it is turned; another one takes its place")
    film = traitlets.Instance(Film, help="The film of the last whole picture")

    def __init__(self, scene, size=(400, 400), *, device=None, title=None, tolerance=None):
        if not isinstance(scene, Scene):
            raise TypeError(f"a scene is shown, not {type(scene).__name__}: relume.open(path), Scene.first_look(volume)")
        self._size = checked_size(size)
        self._asked = {"device": device}
        self._packing = (title, tolerance)
        self._opened = scene
        # Movements that wait, and the thread that marches them.
        self._awake = threading.Condition()
        self._moves = []
        self._worker = None
        film = scene.render(self._size, **self._asked)
        # Without the time of opening the device.
        began = time.perf_counter()
        scene.render([max(1, side // 4) for side in self._size], **self._asked)
        seconds = 16 * (time.perf_counter() - began)
        self._level = next((n for n, share in enumerate(_SHARES) if seconds * share * share <= _QUICK), len(_SHARES) - 1)
        page, view, self._step = film._packed(*self._packing)
        super().__init__(_page=page, _views=[view], scene=scene, film=film)
        self._png = film._repr_png_()
        self.on_msg(self._heard)
        self.observe(self._replaced, "scene")

    def __repr__(self):
        return f"<relume.view of {self.scene!r}>"

    # ---- the camera ----

    def _heard(self, _widget, content, _buffers):
        """Notes movements of the camera from the browser, which come faster than pictures."""
        moves = content.get("moves")
        if moves:
            self._wake(moves)

    def _replaced(self, change):
        if change["new"] is not self._turned:
            self._opened = change["new"]
            self._wake([["scene"]])

    _turned = _told = None

    def _wake(self, moves):
        with self._awake:
            self._moves += moves
            self._awake.notify()
            if self._worker is None:
                self._worker = threading.Thread(target=self._work, name="relume.view", daemon=True)
                self._worker.start()

    def _waiting(self, seconds):
        """Movements that came, within `seconds` from now."""
        with self._awake:
            if not self._moves and seconds:
                self._awake.wait(seconds)
            moves, self._moves = self._moves, []
            return moves

    def _work(self):
        """Marches small pictures while the camera moves, and the whole one when it rests; ends when nothing has moved since."""
        seconds, scene = None, self.scene
        while True:
            moves = self._waiting(_STILL)
            try:
                if moves:
                    scene = self._after(scene, moves)
                    began = time.perf_counter()
                    self._show(scene, _SHARES[self._level], is_moving=True)
                    seconds = time.perf_counter() - began
                    continue
                if seconds is not None:
                    with contextlib.suppress(Cancelled):
                        self._show(scene, 1.0, is_moving=False)
                        self._adapt(seconds)
                        seconds = None
                    continue
            except Exception as error:
                self._tell(f"{type(error).__name__}: {error}")
            seconds = None
            with self._awake:
                if not self._moves:
                    self._worker = None
                    return

    def _after(self, scene, moves):
        """`scene` after movements."""
        for kind, *numbers in moves:
            if kind == "scene":
                scene = self.scene
            elif kind == "reset":
                scene = self._opened
            else:
                scene = scene.moved(**{kind: numbers[0] if len(numbers) == 1 else numbers}, size=self._size)
        return scene

    def _adapt(self, seconds):
        """Chooses the size of the pictures of the next movements, of which the last took `seconds`."""
        if seconds > 1.5 * _QUICK:
            self._level = min(self._level + 1, len(_SHARES) - 1)
        elif seconds < 0.4 * _QUICK:
            self._level = max(self._level - 1, 0)

    def _show(self, scene, share, *, is_moving):
        """Marches and shows a picture; a movement cancels the one at rest."""
        size = [max(1, round(side * share)) for side in self._size]
        progress = None if is_moving else lambda *_: not self._moves
        film = scene.render(size, **self._asked, progress=progress)
        page, view, _ = film._packed(*self._packing, self._step)
        self._turned = scene
        self._hand_over(page, view)
        self.scene = scene
        if is_moving:
            return
        self.film, self._png = film, film._repr_png_()
        # The rounding of this picture, which takes longer than its march.
        page, view, self._step = film._packed(*self._packing, progress=progress)
        self._hand_over(page, view)

    def _hand_over(self, page, view):
        """Gives the browser another picture."""
        with self.hold_sync():
            self.set_trait("_page", page)
            self.set_trait("_views", [view])
        self._tell(None)

    def _tell(self, error):
        """Shows an error in the browser, as nothing else of the thread is seen; or takes it away."""
        if error != self._told:
            self._told = error
            self.send({"error": error})
