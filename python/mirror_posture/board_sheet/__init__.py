"""The board on paper: a PDF at true scale, with instructions for printing and for checking the printer."""

from .draw import write_board_pdf
from .layout import PAPERS_M, BoardSheet, Placement
from .sizes import Recommendation, recommend

__all__ = ["PAPERS_M", "BoardSheet", "Placement", "Recommendation", "recommend", "write_board_pdf"]
