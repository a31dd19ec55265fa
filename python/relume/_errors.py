"""Exceptions and warnings. `code` is the name of an error for programs; it does not change between versions."""


from __future__ import annotations

from typing import Any


class RelumeError(Exception):
    """An error of Relume; `key` is the key of the scene that is wrong, if it is one."""

    def __init__(self, message: str, code: str | None = None, key: str | None = None) -> None:
        super().__init__(message)
        self.code = code
        self.key = key

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.args[0], self.code, self.key)


class SceneError(RelumeError, ValueError):
    """A scene that cannot be read or planned."""


class VolumeError(RelumeError, ValueError):
    """A volume that cannot be read or made."""


class SpectrumError(RelumeError, ValueError):
    """A spectrum that is none."""


class PaletteError(RelumeError, ValueError):
    """A palette that cannot be read or solved."""


class OutputError(RelumeError, OSError):
    """A file that cannot be read or written, or a page that cannot be packed."""

    def __str__(self) -> str:
        return str(self.args[0])


class UnknownNameError(RelumeError, KeyError):
    """A light, position or preset that a film does not have."""

    def __str__(self) -> str:
        return str(self.args[0])


class DeviceError(RelumeError, RuntimeError):
    """A Vulkan device that is missing or fails."""


class DeviceMemoryError(DeviceError, MemoryError):
    """A device with too little memory."""


class Cancelled(RelumeError):
    """Work that its progress ended."""


class RelumeWarning(UserWarning):
    """An oddity of a scene or a picture."""
