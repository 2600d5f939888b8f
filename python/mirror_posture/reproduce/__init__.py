"""The experiments of the paper in simulation: each figure drawn as the paper has it, each statement tested.

`Experiments(Options(...), counting).each()` makes them one by one; `write` puts pictures, table and numbers into a folder.
"""

from .claims import Claim, Experiment
from .page import document, rows, write
from .run import NAMES, Experiments, Options

__all__ = ["NAMES", "Claim", "Experiment", "Experiments", "Options", "document", "rows", "write"]
