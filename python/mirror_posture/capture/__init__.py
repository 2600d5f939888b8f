"""Pictures of a plan's postures, taken by themselves when all is still and sharp, with a page on this machine to look at."""

from .live import state_of
from .loop import Capture
from .recorder import Recorder
from .sources import Source, open_source
from .stage import CaptureOptions, Stage

__all__ = ["Capture", "CaptureOptions", "Recorder", "Source", "Stage", "open_source", "state_of"]
