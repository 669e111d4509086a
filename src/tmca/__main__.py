"""``python -m tmca``."""

from tmca.cli import main

main()
