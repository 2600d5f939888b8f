"""Tests whether the pictures are what they claim to be. See `check`."""

from __future__ import annotations

from .check import Fit, Reading, ViewCheck, check_views, refuse_mistakes, refuse_unnamed_mistakes

__all__ = ["Fit", "Reading", "ViewCheck", "check_views", "refuse_mistakes", "refuse_unnamed_mistakes"]
