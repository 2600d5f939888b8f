"""Captures the pictures of a plan's postures automatically, when everything is still and sharp, with a
local web page."""

from .live import state_of
from .loop import Capture
from .recorder import Recorder
from .sources import Source, open_source
from .stage import CaptureOptions, Stage

__all__ = ["Capture", "CaptureOptions", "Recorder", "Source", "Stage", "open_source", "state_of"]
