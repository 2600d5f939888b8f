"""The keys of the files that people write, each defined once: readers check by them, schemas and reference
pages are generated from them."""

from __future__ import annotations

from .keys import Flag, Key, Number, Numbers, Section, Text, Whole, Wholes

__all__ = ["Flag", "Key", "Number", "Numbers", "Section", "Text", "Whole", "Wholes"]
