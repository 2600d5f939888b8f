"""The board on paper: a PDF at true scale, with what a person needs to print it right and to check the printer."""

from .draw import write_board_pdf
from .layout import PAPERS_M, BoardSheet, Placement
from .sizes import Recommendation, recommend

__all__ = ["PAPERS_M", "BoardSheet", "Placement", "Recommendation", "recommend", "write_board_pdf"]
