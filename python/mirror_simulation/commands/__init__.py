"""Commands that are added to `mirror-posture` by the entry points of this distribution."""
