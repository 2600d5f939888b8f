"""One file a command.

A module here is a command of its own name: it has `ORDER` (its place in the help), `PANEL` (its heading there) and a
function `command`, whose docstring is the help. Heavy imports belong inside the function, so that help is quick.
"""
