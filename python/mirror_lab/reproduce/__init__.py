"""The experiments of the paper in simulation: each figure drawn as the paper has it, each statement tested.

`Experiments(Options(...), counting).each()` makes them one by one; `write` puts pictures, table and numbers into a folder.
"""

from .claims import Claim, Experiment
from .experiments import NAMES, Experiments, Options
from .results_page import document, rows, write

__all__ = ["NAMES", "Claim", "Experiment", "Experiments", "Options", "document", "rows", "write"]
