"""Typed stub of the compiled core; checked against the module by mypy's stubtest."""

__version__: str

class MirrorPostureError(Exception): ...
