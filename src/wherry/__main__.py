"""``python -m wherry`` is the same as ``wherry``."""

from wherry.cli import main

main()
