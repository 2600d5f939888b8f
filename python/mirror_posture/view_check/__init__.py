"""Tests whether the pictures are what they claim to be. See `check`."""

from __future__ import annotations

from .check import ViewCheck, check_views, refuse_mistakes, refuse_unnamed_mistakes
from .readings import Reading

__all__ = ["Reading", "ViewCheck", "check_views", "refuse_mistakes", "refuse_unnamed_mistakes"]
