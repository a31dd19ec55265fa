"""A page in a frame of a notebook."""


class Frame:
    """HTML for front ends with frames, and a PNG for the others."""

    def __init__(self, html, png):
        self._html = html
        self._png = png

    def __repr__(self):
        return "<relume.Film.frame: a page, shown in notebooks>"

    def _repr_mimebundle_(self, include=None, exclude=None):
        import base64

        return {
            "text/html": self._html,
            "image/png": base64.b64encode(self._png).decode(),
            "text/plain": repr(self),
        }
