"""Pictures of a plan's postures, taken by themselves when all is still and sharp, with a page on this machine to look at."""

from .loop import Capture, CaptureOptions, Stage
from .recorder import Recorder
from .sources import Source, open_source

__all__ = ["Capture", "CaptureOptions", "Recorder", "Source", "Stage", "open_source"]
