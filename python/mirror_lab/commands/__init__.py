"""Commands and robots that join `mirror-posture` by the entry points of this distribution."""
